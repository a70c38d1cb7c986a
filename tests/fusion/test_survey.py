from __future__ import annotations

import numpy as np
import pytest

from fusion.survey import survey
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.wall_map import WALL

FRAME = np.array([3.0, -7.0, 2.1])


def test_the_unknown_rim_changes_nothing(view):
    grid = view(0.0, 20.0, FRAME, 1)
    wide = OccupancyGrid(
        np.pad(grid.log_odds, 37),
        grid.resolution_m,
        se2.compose(grid.origin, np.array([-37 * grid.resolution_m, -37 * grid.resolution_m, 0.0])),
    )
    plain, padded = survey(grid), survey(wide)
    assert (plain.walls.states == padded.walls.states).all()
    np.testing.assert_allclose(plain.walls.T_map_grid, padded.walls.T_map_grid, atol=1e-9)
    np.testing.assert_array_equal(plain.probe.points, padded.probe.points)


def test_a_sample_of_cells_stands_for_all_known_area(view):
    grid = view(0.0, 20.0, FRAME, 1)
    surveyed = survey(grid)
    assert len(surveyed.cells) < 30_000
    assert surveyed.cell_area_m2 * len(surveyed.cells) == pytest.approx(np.count_nonzero(grid.known) * 0.05**2)
    assert surveyed.known_m2 == pytest.approx(np.count_nonzero(grid.known) * 0.05**2)


def test_huge_maps_are_taken_at_a_coarser_cell_and_keep_thin_walls():
    cells = np.full((5000, 4000), -3.0, np.float32)
    cells[2501] = 3.0
    surveyed = survey(OccupancyGrid(cells, 0.02, np.zeros(3)))
    assert surveyed.walls.states.size <= 16_000_000
    assert surveyed.walls.resolution_m == pytest.approx(0.04)
    assert (surveyed.walls.states[1250] == WALL).all()
    assert surveyed.wall_m == pytest.approx(80.0, rel=0.01)


@pytest.mark.parametrize("value", [0.0, 3.0, -3.0])
def test_maps_without_walls_or_free_space_say_so(value):
    surveyed = survey(OccupancyGrid(np.full((30, 40), value, np.float32), 0.05, np.zeros(3)))
    assert surveyed.wall_m == 0.0
    assert (surveyed.free_m2 > 0.0) == (value < 0.0)
