"""Looking cells up from another grid."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.resampling import cut_to_known, known_corners, raster_around, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid

POSE = np.array([3.0, -2.0, 0.7])


def grid_of(shape: tuple[int, int] = (30, 40)) -> OccupancyGrid:
    cells = np.random.default_rng(1).uniform(0.5, 6.0, shape).astype(np.float32)
    return OccupancyGrid(cells, 0.05, np.array([1.0, 2.0, 0.3]))


def test_a_grid_on_its_own_raster_is_itself():
    grid = grid_of()
    np.testing.assert_array_equal(resample(grid, se2.IDENTITY, raster_of(grid)), grid.log_odds)


def test_a_cell_is_found_where_it_lies_in_the_other_frame():
    grid = grid_of()
    raster = raster_around(se2.transform_points(POSE, known_corners(grid)), 0.01)
    fine = OccupancyGrid(resample(grid, POSE, raster), raster.resolution_m, raster.origin)
    rows, cols = np.nonzero(grid.known)
    found = np.floor(fine.cell_coordinates(se2.transform_points(POSE, grid.cell_centers(rows, cols)))).astype(int)
    np.testing.assert_array_equal(fine.log_odds[found[:, 1], found[:, 0]], grid.log_odds[rows, cols])
    assert np.count_nonzero(fine.known) * 0.01**2 == pytest.approx(rows.size * 0.05**2, rel=0.01)


def test_outside_of_a_grid_all_is_unknown():
    grid = grid_of()
    assert not resample(grid, np.array([50.0, 0.0, 0.0]), raster_of(grid)).any()


def test_cutting_keeps_every_known_cell_in_its_place():
    grid = grid_of()
    wide = OccupancyGrid(np.pad(grid.log_odds, ((3, 9), (5, 1))), 0.05, grid.origin)
    cut = cut_to_known(wide)
    np.testing.assert_array_equal(cut.log_odds, grid.log_odds)
    np.testing.assert_allclose(cut.origin, se2.compose(grid.origin, np.array([5 * 0.05, 3 * 0.05, 0.0])))


def test_cutting_a_grid_of_nothing_changes_nothing():
    unknown = OccupancyGrid(np.zeros((4, 4), np.float32), 0.05, POSE)
    assert cut_to_known(unknown) is unknown
