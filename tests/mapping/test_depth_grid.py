from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.depth_grid import DepthGridBuilder, add_grids
from mapping.depth_sensor_model import DepthModel
from mapping.errors import MappingError
from mapping.grid import LOG_ODDS_CLAMP, GridBuilder, OccupancyGrid
from mapping.sensor_models import LidarModel, log_odds
from mapping.virtual_scan import VirtualScan

CELL_M = 0.05
MODEL = DepthModel()


def wall(x_m, sigma=0.01, beams=201, half_rad=0.7, free_only=False, near=0.3):
    """A scan of a wall across x = x_m, seen from the origin."""
    angles = np.linspace(-half_rad, half_rad, beams)
    ranges = x_m / np.cos(angles)
    return VirtualScan(
        0, np.zeros(2), angles, ranges * (not free_only), np.full(beams, sigma), np.full(beams, near), ranges
    )


def grid_of(*scans, pose=(0.0, 0.0, 0.0), times=1):
    builder = DepthGridBuilder(CELL_M, MODEL)
    for _ in range(times):
        for scan in scans:
            builder.add_scan(np.array(pose), scan)
    return builder.grid()


def value_at(grid, x, y):
    col, row = np.floor(grid.cell_coordinates(np.array([[x, y]]))[0]).astype(int)
    rows, cols = grid.log_odds.shape
    return float(grid.log_odds[row, col]) if 0 <= row < rows and 0 <= col < cols else 0.0


def test_before_the_wall_free_at_the_wall_occupied_behind_unknown():
    grid = grid_of(wall(2.025))
    assert value_at(grid, 1.0, 0.0) == pytest.approx(MODEL.miss_log_odds)
    assert value_at(grid, 2.025, 0.1) == pytest.approx(log_odds(0.65), rel=1e-4)
    assert value_at(grid, 2.2, 0.0) == 0.0
    assert value_at(grid, -0.5, 0.0) == 0.0
    x, y = grid.cell_centers(*np.nonzero(grid.occupied)).T
    np.testing.assert_allclose(x, 2.025, atol=CELL_M)
    assert y.max() > 1.5 > -1.5 > y.min()


def test_wall_seen_often_is_one_line_however_noisy():
    random = np.random.default_rng(0)
    scans = []
    for _ in range(40):
        scan = wall(2.025, sigma=0.03)
        noisy = scan.ranges_m * (1.0 + 0.01 * random.normal())
        scans.append(VirtualScan(0, scan.origin, scan.angles_rad, noisy, scan.sigma_m, scan.free_from_m, noisy))
    grid = grid_of(*scans)
    x, _ = grid.cell_centers(*np.nonzero(grid.occupied)).T
    assert np.abs(x - 2.025).max() <= 0.1 + 1e-9


def test_pixels_and_beams_of_one_frame_count_once_a_cell():
    sparse, dense = grid_of(wall(1.025, beams=401)), grid_of(wall(1.025, beams=4001))
    assert dense.log_odds.max() == pytest.approx(sparse.log_odds.max()) == pytest.approx(log_odds(0.65), rel=1e-4)
    assert dense.log_odds.min() == sparse.log_odds.min() == pytest.approx(MODEL.miss_log_odds)


def test_what_is_not_known_to_be_free_is_not_cleared():
    nothing = VirtualScan(0, np.zeros(2), np.linspace(-0.7, 0.7, 50), *np.zeros((4, 50)))
    assert not grid_of(nothing).known.any()
    floor_only = grid_of(wall(2.0, free_only=True))
    assert not floor_only.occupied.any()
    assert value_at(floor_only, 1.5, 0.0) < 0.0 == value_at(floor_only, 2.1, 0.0)


def test_what_is_too_near_to_be_seen_is_not_cleared():
    grid = grid_of(wall(2.025, near=1.0))
    assert value_at(grid, 0.9, 0.0) == value_at(grid, 0.3, 0.1) == 0.0
    assert value_at(grid, 1.1, 0.0) < 0.0
    assert np.hypot(*grid.cell_centers(*np.nonzero(grid.known)).T).min() > 1.0 - CELL_M * np.sqrt(2.0)


def test_evidence_adds_up_to_the_clamp_and_a_removed_wall_goes():
    grid = grid_of(wall(2.025), times=40)
    assert grid.log_odds.max() == LOG_ODDS_CLAMP
    assert grid.log_odds.min() == -LOG_ODDS_CLAMP
    builder = DepthGridBuilder(CELL_M, MODEL)
    for scan in [wall(2.025)] * 5 + [wall(3.5, free_only=True)] * 40:
        builder.add_scan(np.zeros(3), scan)
    assert not builder.grid().occupied.any()


def test_pose_and_camera_place_are_honoured_and_the_grid_grows_every_way():
    builder = DepthGridBuilder(CELL_M, MODEL)
    scan = wall(2.025)
    scan = VirtualScan(
        0, np.array([0.1, 0.2]), scan.angles_rad, scan.ranges_m, scan.sigma_m, scan.free_from_m, scan.free_to_m
    )
    for pose in ([0.0, 0.0, 0.0], [30.0, -20.0, np.pi / 2], [-9.0, 14.0, np.pi]):
        builder.add_scan(np.array(pose), scan)
    grid = builder.grid()
    assert value_at(grid, 2.125, 0.2) > 0.0
    assert value_at(grid, 30.0 - 0.2, -20.0 + 0.1 + 2.025) > 0.0
    assert value_at(grid, -9.0 - 2.125, 14.0 - 0.2) > 0.0
    np.testing.assert_allclose(grid.origin[:2] / CELL_M, np.rint(grid.origin[:2] / CELL_M), atol=1e-9)


def random_grid(seed, corner=(0, 0), shape=(7, 9)):
    random = np.random.default_rng(seed)
    cells = np.where(random.random(shape) < 0.5, 0.0, random.normal(0.0, 2.0, shape)).astype(np.float32)
    return OccupancyGrid(cells, CELL_M, np.array([corner[0] * CELL_M, corner[1] * CELL_M, 0.0]))


@given(st.integers(-12, 12), st.integers(-12, 12), st.integers(0, 1000))
def test_adding_grids_adds_each_cell_in_its_place_and_commutes(dx, dy, seed):
    a, b = random_grid(seed), random_grid(seed + 1, (dx, dy), (4, 5))
    total, other = add_grids(a, b), add_grids(b, a)
    np.testing.assert_array_equal(total.log_odds, other.log_odds)
    np.testing.assert_allclose(total.origin, other.origin, atol=1e-9)
    rows, cols = np.nonzero(np.ones(total.log_odds.shape))
    expected = [value_at(a, *center) + value_at(b, *center) for center in total.cell_centers(rows, cols)]
    expected = np.clip(expected, -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP)
    np.testing.assert_allclose(total.log_odds.ravel(), expected, atol=1e-3)


def test_adding_an_unknown_grid_changes_nothing_and_what_cancels_stays_known():
    a = random_grid(4)
    unknown = OccupancyGrid(np.zeros((3, 3), np.float32), CELL_M, a.origin)
    np.testing.assert_array_equal(add_grids(a, unknown).log_odds, a.log_odds)
    opposite = OccupancyGrid(-a.log_odds, CELL_M, a.origin)
    np.testing.assert_array_equal(add_grids(a, opposite).known, a.known)


def test_grids_turned_alike_add_up_as_they_lie():
    turned = OccupancyGrid(random_grid(1).log_odds, CELL_M, np.array([3.0, 1.0, 0.5]))
    step = np.array([np.cos(0.5) * 2 - np.sin(0.5) * 3, np.sin(0.5) * 2 + np.cos(0.5) * 3]) * CELL_M
    beside = OccupancyGrid(random_grid(2).log_odds, CELL_M, np.array([3.0 + step[0], 1.0 + step[1], 0.5]))
    total = add_grids(turned, beside)
    for center in total.cell_centers(*np.nonzero(total.known)):
        added = np.clip(value_at(turned, *center) + value_at(beside, *center), -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP)
        assert value_at(total, *center) == pytest.approx(added, abs=2e-3)


@pytest.mark.parametrize("origin", [(0.01, 0.0, 0.0), (0.0, 0.0, 0.1)])
def test_grids_whose_cells_do_not_match_are_refused(origin):
    with pytest.raises(MappingError, match="cell by cell"):
        add_grids(random_grid(1), OccupancyGrid(np.zeros((2, 2), np.float32), CELL_M, np.array(origin)))
    with pytest.raises(MappingError, match="cell by cell"):
        add_grids(random_grid(1), OccupancyGrid(np.zeros((2, 2), np.float32), 0.1, np.zeros(3)))


def test_lidar_and_camera_of_one_car_agree_in_one_grid():
    scan = wall(2.025)
    lidar = GridBuilder(CELL_M, LidarModel())
    bearings = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    bearings = bearings[np.abs(bearings) < 1.2]
    lidar.add_scan(np.zeros(2), 2.025 * np.column_stack([np.ones(len(bearings)), np.tan(bearings)]))
    camera, laser = grid_of(scan), lidar.grid()
    both = add_grids(camera, laser)
    for place in ((1.0, 0.0), (2.025, 0.3), (1.5, 2.0), (2.025, 3.0)):
        assert value_at(both, *place) == pytest.approx(value_at(camera, *place) + value_at(laser, *place), rel=1e-5)
