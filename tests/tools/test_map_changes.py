from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.map_changes import changed

CELL_M = 0.05


def hall() -> OccupancyGrid:
    """A hall of 18 x 18 m in a grid of 20 x 20 m, one cell of wall around."""
    cells = np.zeros((400, 400), np.float32)
    cells[20:380, 20:380] = 3.0
    cells[21:379, 21:379] = -4.0
    return OccupancyGrid(cells, CELL_M, np.array([1.0, 2.0, 0.3]))


def test_much_stays_and_something_changes_otherwise_each_time():
    grid = hall()
    random = np.random.default_rng(1)
    results = [changed(grid, random) for _ in range(6)]
    for result in results:
        assert result.resolution_m == grid.resolution_m
        assert np.array_equal(result.origin, grid.origin)
        assert 0.0 < np.mean(result.log_odds != grid.log_odds) < 0.35
        assert (result.log_odds[:15] == 0.0).all()  # what nobody saw stays unknown
    assert len({result.log_odds.tobytes() for result in results}) == 6
    assert (grid.log_odds == hall().log_odds).all()


def test_the_same_random_numbers_give_the_same_changes():
    first, second = (changed(hall(), np.random.default_rng(3)) for _ in range(2))
    assert first.log_odds.tobytes() == second.log_odds.tobytes()


def test_walls_go_and_things_come_in_some_of_many():
    grid = hall()
    wall, free = grid.log_odds > 0.0, grid.log_odds < 0.0
    results = [changed(grid, np.random.default_rng(seed)).log_odds for seed in range(12)]
    assert any((cells[wall] < 0.0).any() for cells in results)
    assert any((cells[wall] == 0.0).any() for cells in results)
    middle = np.zeros_like(wall)
    middle[100:300, 100:300] = True
    assert all((cells[middle] != 0.0).all() for cells in results)  # things hide nothing
    assert sum((cells[middle & free] > 0.0).any() for cells in results) >= 8


@pytest.mark.parametrize("value", [0.0, 3.0, -3.0])
def test_a_map_of_one_kind_of_cells_is_no_error(value):
    changed(OccupancyGrid(np.full((30, 40), value, np.float32), CELL_M, np.zeros(3)), np.random.default_rng(0))
