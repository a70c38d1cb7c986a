"""What a scan tells: the part of the map around the car agrees with the whole, and new things stand in it."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.raycast import cast_rays
from mapping.slam import MappedScan
from planning.collision import contact_at
from planning.costmap import costmap
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.map_of_today import SavedGround, near_costmap, with_points

CELL_M = 0.05
ORIGIN = np.array([-2.0, 3.0, 0.4])
CAR = Vehicle(margin_m=0.0)
SETTINGS = AutopilotSettings()
HALL = (240, 300)  # 12 m x 15 m
START = np.array([2.0, 6.0, 0.0])


def hall():
    occupied = np.zeros(HALL, np.bool_)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    occupied[140:, 60:80] = True
    return occupied


def grid_of(occupied):
    return OccupancyGrid(np.where(occupied, 5.0, -5.0).astype(np.float32), CELL_M, ORIGIN)


def scan(occupied, number, local=START, accepted=True):
    """What is seen from a pose in the hall's axes; odometry begins there."""
    bearings = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    starts = np.tile(local[:2] / CELL_M, (720, 1))
    ranges_m = cast_rays(occupied, starts, bearings + local[2], 16.0 / CELL_M) * CELL_M + 0.02
    points = np.column_stack([np.cos(bearings), np.sin(bearings)]) * ranges_m[:, np.newaxis]
    match = ScanMatch(np.zeros(3), np.zeros(3), accepted=accepted)
    return MappedScan(number * 100_000_000, np.zeros(3), match, points, False, False)


@pytest.fixture
def ground():
    return SavedGround(grid_of(hall()), Vehicle(), np.zeros(2), SETTINGS, se2.compose(ORIGIN, START))


def ahead(local=START, most_m=2.5):
    steps = np.arange(0.0, most_m, 0.01)
    poses = np.column_stack([local[0] + steps, np.full(len(steps), local[1]), np.zeros(len(steps))])
    return se2.compose(ORIGIN, poses)


def test_near_the_car_the_part_agrees_with_the_whole():
    random = np.random.default_rng(4)
    whole = grid_of(hall() | (random.random(HALL) < 0.002))
    full = costmap(whole, CAR, SETTINGS.unknown)
    for x, y, yaw in random.uniform([0.5, 0.5, -np.pi], [14.5, 11.5, np.pi], (20, 3)):
        pose = se2.compose(ORIGIN, np.array([x, y, yaw]))
        near = near_costmap(whole, pose, CAR, SETTINGS)
        steps = np.column_stack([np.arange(0.0, 2.5, 0.01), np.zeros((250, 2))])
        way = se2.compose(pose, steps)
        assert contact_at(near, way) == contact_at(full, way)
        assert near.clearance_m(way[:1]) == pytest.approx(full.clearance_m(way[:1]))


def test_a_car_beside_the_map_finds_nothing_free_there():
    near = near_costmap(grid_of(hall()), se2.compose(ORIGIN, np.array([-5.0, 40.0, 0.0])), CAR, SETTINGS)
    assert contact_at(near, ahead(np.array([-5.0, 40.0, 0.0]))) == 0


def test_a_scan_that_was_not_matched_tells_nothing(ground):
    assert ground.add(scan(hall(), 0, accepted=False)) is None


def test_before_it_is_known_there_is_no_place_but_a_reason(ground):
    sight = ground.add(scan(hall(), 0))
    assert sight.place is None
    assert "told place" in sight.reason


def test_a_box_of_today_is_in_the_map_and_near(ground):
    today = hall()
    today[115:125, 70:76] = True  # ahead, from x = 3.5 m on
    for number in range(10):
        sight = ground.add(scan(today, number))
    place = sight.place
    np.testing.assert_allclose(place.located.T_map_base, se2.compose(ORIGIN, START), atol=0.03)
    assert contact_at(place.near, ahead()) == pytest.approx(100 * (1.5 - 0.3405), abs=6)
    assert contact_at(costmap(place.grid, CAR, SETTINGS.unknown), ahead()) == contact_at(place.near, ahead())


def test_what_was_told_before_does_not_change(ground):
    for number in range(6):
        before = ground.add(scan(hall(), number))
    known, free = before.place.grid.log_odds.copy(), contact_at(before.place.near, ahead())
    today = hall()
    today[115:125, 70:76] = True
    for number in range(6, 16):
        ground.add(scan(today, number))
    np.testing.assert_array_equal(before.place.grid.log_odds, known)
    assert free is None
    assert contact_at(before.place.near, ahead()) is None


def test_points_stand_on_the_map_unless_they_are_its_walls():
    saved = grid_of(hall())
    local = np.array([[5.02, 5.02], [0.07, 5.0], [-3.0, 5.0]])  # in the open, beside the wall, outside
    seen = with_points(saved, se2.transform_points(ORIGIN, local))
    changed = np.argwhere(seen.log_odds != saved.log_odds)
    np.testing.assert_array_equal(changed, [[100, 100]])
    assert seen.occupied[100, 100]


def test_where_the_place_is_by_odometry_the_scan_still_blocks_and_the_map_does_not_learn(ground):
    for number in range(6):
        sight = ground.add(scan(hall(), number))
    known = sight.place.grid
    moved = np.array([0.3, 0.0, 0.0])
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (300, 2)) + np.array([1.0, 0.0])  # fits no wall; 1 m ahead
    match = ScanMatch(moved, np.zeros(3), accepted=True)
    sight = ground.add(MappedScan(2 * 10**9, moved, match, points, False, False))
    assert sight.place.located.by_odometry
    assert sight.place.grid is known
    hit = contact_at(sight.place.near, ahead(START + moved))
    assert hit is not None
    assert hit < 60
