"""The guide of the car's planner: a route of grid cells that keeps its distance from walls where that costs little.

A* (Hart, Nilsson, Raphael 1968) over 16 directions, of which the longest errs by 2.7 % in length, on the costmap's
price per metre. It is a guide only: whether a car can follow it is decided by `joining`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.footprint import Distances, Mask, is_free
from planning.heap import pop, push

FloatArray = NDArray[np.float64]
Prices = NDArray[np.float32]
IntArray = NDArray[np.int64]

# Row, column, length, and the two cells that a knight's or a diagonal step passes between.
_STEPS = np.array(
    [
        [0, 1, 0, 1, 0, 1], [0, -1, 0, -1, 0, -1], [1, 0, 1, 0, 1, 0], [-1, 0, -1, 0, -1, 0],
        [1, 1, 0, 1, 1, 0], [1, -1, 0, -1, 1, 0], [-1, 1, 0, 1, -1, 0], [-1, -1, 0, -1, -1, 0],
        [1, 2, 0, 1, 1, 1], [1, -2, 0, -1, 1, -1], [-1, 2, 0, 1, -1, 1], [-1, -2, 0, -1, -1, -1],
        [2, 1, 1, 0, 1, 1], [2, -1, 1, 0, 1, -1], [-2, 1, -1, 0, -1, 1], [-2, -1, -1, 0, -1, -1],
    ],
    dtype=np.int64,
)  # fmt: skip
_LENGTHS = np.hypot(_STEPS[:, 0], _STEPS[:, 1])
_YAWS = np.arctan2(_STEPS[:, 0], _STEPS[:, 1]).astype(np.float64)
_TIGHT = 10.0  # on a metre in a direction in which the car does not fit
_SLOPE = math.sqrt(5.0) - 2.0


@njit(cache=True)
def find_route(
    price: Prices,
    room_m: Distances,
    anchors: FloatArray,
    narrow_m: float,
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    start: tuple[int, int],
    goal: tuple[int, int],
    greed: float,
) -> IntArray:
    """Return the cells (N, 2) of a guide's route, row and column, both ends included; N is 0 where there is none.

    price, room_m, anchors are those of the guide (see there), with narrow_m: where there is less room, going on in a
    direction in which the car does not fit at the anchor is dear. The route costs at most greed times the least.
    blocked, distance_m, cell_m and corners are those of `footprint`.
    """
    rows, cols = price.shape
    cost = np.full(rows * cols, np.inf, dtype=np.float32)
    came_by = np.full(rows * cols, -1, dtype=np.int8)
    done = np.zeros(rows * cols, dtype=np.bool_)
    keys, cells, count = np.empty(4096, dtype=np.float32), np.empty(4096, dtype=np.int32), 0
    first, last = start[0] * cols + start[1], goal[0] * cols + goal[1]
    cost[first] = 0.0
    keys, cells, count = push(keys, cells, count, greed * _bound(start[0], start[1], goal), first)
    while count:
        cell = cells[0]
        count = pop(keys, cells, count)
        if cell == last:
            return _backwards(came_by, first, last, cols)
        if done[cell]:
            continue
        done[cell] = True
        row, col = cell // cols, cell % cols
        for step in range(len(_STEPS)):
            to_row, to_col = row + _STEPS[step, 0], col + _STEPS[step, 1]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            metre = _metre(price, row, col, step)
            if metre == np.inf:
                continue
            if room_m[to_row, to_col] < narrow_m:
                x, y, yaw = anchors[to_row, to_col, 0], anchors[to_row, to_col, 1], _YAWS[step]
                if not is_free(blocked, distance_m, cell_m, x, y, yaw, corners) and not is_free(
                    blocked, distance_m, cell_m, x, y, yaw + math.pi, corners
                ):
                    metre += _TIGHT
            total = np.float32(cost[cell] + _LENGTHS[step] * metre)
            target = to_row * cols + to_col
            if total < cost[target]:
                cost[target] = total
                came_by[target] = step
                keys, cells, count = push(keys, cells, count, total + greed * _bound(to_row, to_col, goal), target)
    return np.empty((0, 2), dtype=np.int64)


@njit(cache=True)
def costs_to(price: Prices, goal: tuple[int, int]) -> Prices:
    """Return what a route from each cell (rows, cols) to the goal costs, in widths of a cell (Dijkstra 1959, 8 steps).

    inf where there is none. Steps between the corners of two forbidden cells are allowed: a bound, not a route.
    """
    rows, cols = price.shape
    cost = np.full((rows, cols), np.inf, dtype=np.float32)
    keys, cells, count = np.empty(4096, dtype=np.float32), np.empty(4096, dtype=np.int32), 0
    cost[goal] = 0.0
    keys, cells, count = push(keys, cells, count, 0.0, goal[0] * cols + goal[1])
    while count:
        key, cell = keys[0], cells[0]
        count = pop(keys, cells, count)
        row, col = cell // cols, cell % cols
        if key > cost[row, col]:
            continue
        for step in range(8):
            to_row, to_col = row + _STEPS[step, 0], col + _STEPS[step, 1]
            if not (0 <= to_row < rows and 0 <= to_col < cols) or price[to_row, to_col] == np.inf:
                continue
            here = min(price[row, col], price[to_row, to_col])  # the goal's own cell may be forbidden
            total = np.float32(key + _LENGTHS[step] * (here + price[to_row, to_col]) / 2.0)
            if total < cost[to_row, to_col]:
                cost[to_row, to_col] = total
                keys, cells, count = push(keys, cells, count, total, to_row * cols + to_col)
    return cost


@njit(cache=True)
def _metre(price: Prices, row: int, col: int, step: int) -> float:
    """Return what a cell's width costs on a step out of a cell; inf where it leads into or between forbidden cells."""
    there: float = price[row + _STEPS[step, 0], col + _STEPS[step, 1]]
    if step < 4:
        return there
    one: float = price[row + _STEPS[step, 2], col + _STEPS[step, 3]]
    other: float = price[row + _STEPS[step, 4], col + _STEPS[step, 5]]
    return 0.25 * (one + other) + 0.5 * there


@njit(cache=True)
def _bound(row: int, col: int, goal: tuple[int, int]) -> float:
    """Return the length of the way over 16 directions in an empty grid, in cells."""
    a, b = abs(row - goal[0]), abs(col - goal[1])
    longer, shorter = max(a, b), min(a, b)
    if 2 * shorter <= longer:
        return longer + _SLOPE * shorter
    return 1.4142135 * (2 * shorter - longer) + 2.2360680 * (longer - shorter)


@njit(cache=True)
def _backwards(came_by: NDArray[np.int8], first: int, last: int, cols: int) -> IntArray:
    count, cell = 1, last
    while cell != first:
        step = came_by[cell]
        cell -= _STEPS[step, 0] * cols + _STEPS[step, 1]
        count += 1
    route = np.empty((count, 2), dtype=np.int64)
    cell = last
    for place in range(count - 1, -1, -1):
        route[place, 0], route[place, 1] = cell // cols, cell % cols
        if place:
            step = came_by[cell]
            cell -= _STEPS[step, 0] * cols + _STEPS[step, 1]
    return route
