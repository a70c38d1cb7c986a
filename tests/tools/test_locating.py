"""The place on a saved map: from what the car is told, from nothing, and anew where what it was told is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_tracking import TrackingSettings
from mapping.odometry import ScanMatch
from mapping.raycast import cast_rays
from mapping.slam import MappedScan
from tools.locating import Locating

CELL_M = 0.05
BEAMS = 1200
TRUE = np.array([5.0, 4.5, 0.5])
T_MAP_ODOM = np.array([1.0, -2.0, 0.3])
NO_OFFSET = np.zeros(2)


@pytest.fixture(scope="module")
def walls():
    """14 m x 10 m with blocks, so that no other place looks the same; 300 points of wall are seen at once."""
    occupied = np.zeros((200, 280), np.bool_)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    occupied[120:, 20:65] = True
    occupied[:45, 160:190] = True
    return occupied


@pytest.fixture
def saved(walls):
    return OccupancyGrid(np.where(walls, 5.0, -5.0).astype(np.float32), CELL_M, np.zeros(3))


def scan(walls, number, pose=TRUE):
    bearings = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    starts = np.tile(pose[:2] / CELL_M, (BEAMS, 1))
    ranges_m = cast_rays(walls, starts, bearings + pose[2], 12.0 / CELL_M) * CELL_M
    points = np.column_stack([np.cos(bearings), np.sin(bearings)]) * (ranges_m + 0.02)[:, np.newaxis]
    odom = se2.compose(se2.inverse(T_MAP_ODOM), pose)
    match = ScanMatch(odom, np.zeros(3), accepted=True)
    return MappedScan(number * 100_000_000, odom, match, points, False, False)


def test_what_is_seen_of_a_small_room_is_not_enough_and_it_says_what_is_wanted(saved, walls):
    few = scan(walls, 0)
    near = few.points[np.hypot(*few.points.T) < 4.5]
    locating = Locating(saved, None, NO_OFFSET, TrackingSettings())
    assert locating.add(MappedScan(0, few.pose, few.match, near, False, False)) is None
    assert "150 are needed" in locating.reason
    assert "push the car on" in locating.reason


def places(locating, walls, count):
    return [locating.add(scan(walls, number)) for number in range(count)]


def assert_found(place):
    assert place is not None
    np.testing.assert_allclose(place.T_map_base, TRUE, atol=0.03)
    np.testing.assert_allclose(place.T_map_odom, T_MAP_ODOM, atol=0.05)
    assert not place.by_odometry


def test_the_first_scans_make_the_told_place_exact(saved, walls):
    told = se2.compose(TRUE, np.array([0.08, -0.06, 0.05]))
    locating = Locating(saved, told, NO_OFFSET, TrackingSettings())
    found = places(locating, walls, 6)
    assert found[:4] == [None] * 4
    assert_found(found[4])
    assert_found(found[5])
    assert "on walls" in locating.reason


def test_a_standing_car_is_found_without_being_told(saved, walls):
    locating = Locating(saved, None, NO_OFFSET, TrackingSettings())
    found = places(locating, walls, 3)
    assert_found(found[-1])


def test_where_it_was_told_wrong_it_looks_everywhere_and_says_so(saved, walls):
    locating = Locating(saved, np.array([1.0, 1.0, -2.0]), NO_OFFSET, TrackingSettings())
    assert places(locating, walls, 5) == [None] * 5
    assert "not where it was told to be" in locating.reason
    assert_found(places(locating, walls, 3)[-1])


def test_among_places_that_look_alike_it_finds_none_and_says_why():
    occupied = np.zeros((160, 280), np.bool_)
    occupied[[0, -1], :] = occupied[:, [0, -1]] = True  # a rectangle looks the same from the other end
    saved = OccupancyGrid(np.where(occupied, 5.0, -5.0).astype(np.float32), CELL_M, np.zeros(3))
    locating = Locating(saved, None, NO_OFFSET, TrackingSettings())
    assert places(locating, occupied, 4) == [None] * 4
    assert "ambiguous" in locating.reason


def test_a_place_that_is_lost_is_looked_for_everywhere(saved, walls):
    locating = Locating(saved, TRUE, NO_OFFSET, TrackingSettings(lost_m=0.5))
    assert_found(places(locating, walls, 6)[-1])
    random = np.random.default_rng(2)
    for step in range(1, 40):  # it is said to drive, and the scans fit nowhere
        odom = se2.compose(scan(walls, 0).match.pose, np.array([0.06 * step, 0.0, 0.0]))
        match = ScanMatch(odom, np.zeros(3), accepted=True)
        rubbish = random.uniform(-1.0, 1.0, (300, 2))
        place = locating.add(MappedScan(10**9 + step, odom, match, rubbish, False, False))
        if place is None:
            break
        assert place.by_odometry
    assert place is None
    assert "lost after" in locating.reason
    assert_found(places(locating, walls, 3)[-1])
