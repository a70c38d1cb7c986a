"""Routes against Dijkstra's algorithm as scipy has it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from planning.route import find_route
from planning.vehicle import Vehicle

STEPS = [(r, c) for r in range(-2, 3) for c in range(-2, 3) if np.gcd(r, c) == 1]


def priced(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    price = (1.0 + 3.0 * rng.random((18, 24))).astype(np.float32)
    price[rng.random(price.shape) < 0.2] = np.inf
    price[0, 0] = price[-1, -1] = 1.0
    return price


def step_cost(price: np.ndarray, row: int, col: int, step: tuple[int, int]) -> float:
    """What a step costs: half of the price where it ends, and half of those it passes between."""
    there = float(price[row + step[0], col + step[1]])
    if 0 in step:
        return there
    r, c = np.sign(step).tolist()
    diagonal = [(r, 0), (0, c)]
    between = diagonal if abs(step[0]) == abs(step[1]) else [(0, c) if abs(step[1]) == 2 else (r, 0), (r, c)]
    passed = sum(float(price[row + i, col + j]) for i, j in between)
    return float(np.hypot(*step)) * (0.25 * passed + 0.5 * there)


def graph(price: np.ndarray) -> coo_array:
    rows, cols = price.shape
    edges = [
        (row * cols + col, (row + step[0]) * cols + col + step[1], step_cost(price, row, col, step))
        for row in range(rows)
        for col in range(cols)
        for step in STEPS
        if 0 <= row + step[0] < rows and 0 <= col + step[1] < cols
    ]
    first, second, cost = (np.array(part) for part in zip(*edges, strict=True))
    real = np.isfinite(cost)
    return coo_array((cost[real], (first[real], second[real])), shape=(price.size, price.size))


def route(price: np.ndarray, greed: float, blocked: np.ndarray | None = None, narrow_m: float = 0.0) -> np.ndarray:
    rows, cols = price.shape
    anchors = np.stack(np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5), axis=-1)
    blocked = np.zeros(price.shape, bool) if blocked is None else blocked
    room_m = np.where(blocked, 0.0, 1.0).astype(np.float32)
    where = (blocked, room_m, 1.0, Vehicle().corners)
    return find_route(price, room_m, anchors, narrow_m, *where, (0, 0), (rows - 1, cols - 1), greed)


def cost(price: np.ndarray, cells: np.ndarray) -> float:
    pairs = zip(cells[:-1].tolist(), np.diff(cells, axis=0).tolist(), strict=True)
    return sum(step_cost(price, row, col, tuple(step)) for (row, col), step in pairs)


@pytest.mark.parametrize("seed", range(8))
def test_a_route_costs_what_dijkstras_does_and_a_greedy_one_not_much_more(seed):
    price = priced(seed)
    best = float(dijkstra(graph(price).tocsr(), indices=0)[-1])
    exact, greedy = route(price, 1.0), route(price, 1.2)
    if not np.isfinite(best):
        assert len(exact) == 0
        return
    assert exact[0].tolist() == [0, 0]
    assert exact[-1].tolist() == [price.shape[0] - 1, price.shape[1] - 1]
    assert cost(price, exact) == pytest.approx(best, rel=1e-5)
    assert best * (1 - 1e-5) <= cost(price, greedy) <= 1.2 * best


def test_there_is_no_route_through_a_wall():
    price = np.ones((12, 12), np.float32)
    price[:, 6] = np.inf
    assert route(price, 1.0).shape == (0, 2)
    price[11, 6] = 1.0
    assert [11, 6] in route(price, 1.0).tolist()
