"""A map that is being made as ground to drive on: where the car is, and what it may drive on.

A whole drive is in test_exploring_evaluation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from planning.costmap import UnknownSpace, costmap
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.growing_ground import GrowingGround, exploring, reaching

FloatArray = NDArray[np.float64]
CELL_M = 0.05


def seen() -> OccupancyGrid:
    """Free ground of 2 m x 1 m about the origin, with a wall at its right end, in a frame of its own."""
    cells = np.full((20, 40), -3.0, np.float32)
    cells[:, -1] = 3.0
    return OccupancyGrid(cells, CELL_M, np.array([-0.5, -0.5, 0.0]))


def scan(pose: np.ndarray, *, accepted: bool = True) -> MappedScan:
    """A scan at a pose of the map; odom is turned against it."""
    odom = se2.compose(np.array([1.0, 0.0, 0.5]), pose)
    match = ScanMatch(odom, np.zeros(3), accepted=accepted)
    return MappedScan(5, pose, match, np.zeros((0, 2)), wheel_guess=False, is_keyframe=False)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (3.0, -2.0, 0.7)])
def test_cells_around_are_unknown_and_the_others_stay_where_they_are(origin):
    grid = OccupancyGrid(seen().log_odds, CELL_M, np.array(origin))
    places = se2.transform_points(grid.origin, np.array([[7.0, -3.0], [0.2, 0.2]]))
    body = se2.transform_points(grid.origin, np.array([[7.0, -3.0], [7.3, -3.0], [7.3, -2.7], [7.0, -2.7]]))
    larger = reaching(grid, places, 1.0, body)
    middles = se2.transform_points(grid.origin, (np.argwhere(grid.log_odds > -9)[:, ::-1] + 0.5) * CELL_M)
    col, row = np.floor(larger.cell_coordinates(middles)).astype(int).T
    np.testing.assert_array_equal(larger.log_odds[row, col], grid.log_odds.ravel())
    under = np.floor(larger.cell_coordinates(body.mean(axis=0, keepdims=True))).astype(int)[0, ::-1]
    assert larger.log_odds[tuple(under)] < 0.0
    assert np.count_nonzero(larger.log_odds) - grid.log_odds.size == pytest.approx((0.3 / CELL_M) ** 2, rel=0.5)
    rows, cols = larger.log_odds.shape
    at = larger.cell_coordinates(places)
    assert (at >= 1.0 / CELL_M - 1e-6).all()
    assert (at <= np.array([cols, rows]) - 1.0 / CELL_M + 1e-6).all()


def test_where_the_car_stands_there_is_no_wall():
    car, pose = Vehicle(margin_m=0.0), np.array([1.1, 0.1, 0.2])  # its front is in the cells of the wall
    assert not costmap(seen(), car, UnknownSpace.costly).fits(pose)
    mended = reaching(seen(), pose[np.newaxis, :2], 1.0, se2.transform_points(pose, car.body))
    assert costmap(mended, car, UnknownSpace.costly).fits(pose)
    assert np.count_nonzero(mended.occupied) >= 13  # the others of the wall's 20 cells are still there


def test_a_scan_gives_the_place_by_slam_and_the_map_with_it():
    goal = np.array([9.0, 0.0, 0.0])
    settings = exploring(AutopilotSettings())
    ground = GrowingGround(seen, Vehicle(), settings, [goal])
    assert ground.add(scan(np.zeros(3), accepted=False)) is None
    guessed = ground.add(replace(scan(np.zeros(3)), in_map=False))
    assert guessed is not None
    assert guessed.place is None
    assert "tracking was lost" in guessed.reason
    pose = np.array([0.2, 0.1, 0.3])
    sight = ground.add(scan(pose))
    assert sight is not None
    assert sight.place is not None
    np.testing.assert_array_equal(sight.place.located.T_map_base, pose)
    np.testing.assert_allclose(sight.place.located.T_map_odom, se2.inverse(np.array([1.0, 0.0, 0.5])), atol=1e-12)
    whole = costmap(sight.place.grid, Vehicle(), settings.unknown)
    assert whole.fits(goal)  # nobody has seen it, and it is on the ground all the same
    assert not whole.fits(np.array([1.4, 0.0, 0.0]))  # the wall


def test_a_car_that_explores_keeps_off_walls_and_may_drive_where_nobody_looked():
    usual = AutopilotSettings()
    settings = exploring(usual)
    assert usual.unknown is UnknownSpace.forbidden
    assert settings.unknown is UnknownSpace.costly
    assert list(settings.margins_m) == sorted({0.15, 0.08, *usual.margins_m}, reverse=True)
    assert exploring(AutopilotSettings(unknown=UnknownSpace.free)).unknown is UnknownSpace.free
