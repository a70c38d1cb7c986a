from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.wall_map import FAR_M, FREE, UNKNOWN, WALL, distances_to, middles, wall_map


def test_states_follow_the_evidence_and_the_bound_for_free_cells():
    cells = np.array([[0.0, -0.5, -2.0, 0.3, 0.7]], np.float32)
    grid = OccupancyGrid(cells, 0.1, np.array([3.0, -1.0, 0.2]))
    strict, lax = wall_map(grid, free_below=-0.62), wall_map(grid, free_below=-0.4)
    assert strict.states.tolist() == [[UNKNOWN, UNKNOWN, FREE, UNKNOWN, WALL]]
    assert lax.states.tolist() == [[UNKNOWN, FREE, FREE, UNKNOWN, WALL]]
    assert strict.T_map_grid.tolist() == [3.0, -1.0, 0.2]


def test_distances_are_those_to_the_nearest_wall_cell():
    walls = np.zeros((50, 60), np.bool_)
    walls[10, 20] = walls[40, 5] = True
    distances = distances_to(walls, 0.1)
    rows, cols = np.indices(walls.shape)
    truth = 0.1 * np.minimum(np.hypot(rows - 10, cols - 20), np.hypot(rows - 40, cols - 5))
    assert distances == pytest.approx(np.minimum(truth, FAR_M), abs=1e-5)


def test_without_walls_everything_is_far():
    assert (distances_to(np.zeros((3, 4), np.bool_), 0.05) == FAR_M).all()


def test_middles_lie_half_a_cell_from_the_corner():
    assert middles(np.array([[False, True], [True, False]]), 0.2).tolist() == pytest.approx(
        np.array([[0.3, 0.1], [0.1, 0.3]])
    )


def test_distances_are_the_same_bits_each_time_and_exact():
    random = np.random.default_rng(0)
    walls = random.random((83, 131)) < 0.01
    rows, cols = np.nonzero(walls)
    away = np.indices(walls.shape).reshape(2, -1, 1) - np.array([rows, cols])[:, np.newaxis]
    exact = np.sqrt((away**2).sum(axis=0).min(axis=1).astype(np.float32)).reshape(walls.shape) * np.float32(0.05)
    for _ in range(20):
        assert distances_to(walls, 0.05).tobytes() == np.minimum(exact, np.float32(2.0)).tobytes()
