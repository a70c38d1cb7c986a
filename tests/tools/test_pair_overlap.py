"""Free space and wall in common: the length of a wall is its length at any angle, in any frame and resolution."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.sensor_models import LidarModel
from tools.pair_overlap import common_free, common_wall_m, free_area_m2, wall_line

NOWHERE = np.array([500.0, 0.0, 0.0])


def wall_seen(direction_rad, resolution_m, length_m=10.0):
    """A map of one straight wall, seen from 2 m off while driving along it."""
    along = np.array([np.cos(direction_rad), np.sin(direction_rad)])
    aside = np.array([along[1], -along[0]])
    random = np.random.default_rng(0)
    builder = GridBuilder(resolution_m, LidarModel(noise_fraction=0.0))
    points = np.linspace(-length_m / 2.0, length_m / 2.0, 2000)[:, np.newaxis] * along
    for at in np.linspace(-length_m / 2.0, length_m / 2.0, 21):
        builder.add_scan(at * along + 2.0 * aside + 0.013, points + random.normal(0.0, 0.01, (2000, 1)) * aside)
    return builder.grid()


@pytest.mark.parametrize("resolution_m", [0.04, 0.1])
@pytest.mark.parametrize("direction_deg", [0.0, 10.0, 22.5, 45.0, 60.0, 90.0, 137.0])
def test_ten_metres_of_wall_are_ten_metres(direction_deg, resolution_m):
    line = wall_line(wall_seen(np.radians(direction_deg), resolution_m))
    assert line.lengths_m.sum() == pytest.approx(10.0, rel=0.06)


def test_the_inside_of_a_thick_wall_does_not_count():
    cells = np.full((40, 200), -3.0, np.float32)
    cells[20:35] = 3.0  # 0.75 m thick, free space before and behind it
    grid = OccupancyGrid(cells, 0.05, np.array([3.0, 4.0, 0.7]))
    assert wall_line(grid).lengths_m.sum() == pytest.approx(2 * 10.0, rel=0.03)


def test_a_map_without_walls_has_none_in_common():
    empty = wall_line(OccupancyGrid(np.full((5, 5), -3.0, np.float32), 0.05, np.zeros(3)))
    wall = wall_line(wall_seen(0.3, 0.05))
    assert len(empty.points) == 0
    assert common_wall_m(empty, wall, se2.IDENTITY) == common_wall_m(wall, empty, se2.IDENTITY) == 0.0


def test_a_map_shares_its_whole_wall_with_itself_and_less_the_farther_off():
    line = wall_line(wall_seen(0.4, 0.05))
    whole = line.lengths_m.sum()
    assert common_wall_m(line, line, se2.IDENTITY) == pytest.approx(whole)
    along = np.array([3.0 * np.cos(0.4), 3.0 * np.sin(0.4), 0.0])
    assert common_wall_m(line, line, along) == pytest.approx(whole - 3.0, abs=0.4)
    assert common_wall_m(line, line, NOWHERE) == 0.0


def test_the_same_wall_at_two_resolutions_and_in_two_frames_is_shared():
    T_a_b = np.array([7.0, -2.0, 2.2])
    a, b = wall_seen(0.4, 0.04), wall_seen(0.4 - 2.2, 0.1)  # b's frame is turned by 2.2 rad in a's
    shift = np.array([*T_a_b[:2], 0.0])
    moved_a = OccupancyGrid(a.log_odds, a.resolution_m, se2.compose(shift, a.origin))
    assert common_wall_m(wall_line(moved_a), wall_line(b), T_a_b) == pytest.approx(10.0, rel=0.05)


def test_free_space_is_all_shared_with_itself_and_none_elsewhere():
    grid = wall_seen(0.4, 0.05)
    whole = common_free(grid, grid, se2.IDENTITY)
    assert whole.share == 1.0
    assert whole.area_m2 == pytest.approx(free_area_m2(grid))
    apart = common_free(grid, grid, NOWHERE)
    assert (apart.area_m2, apart.share) == (0.0, 0.0)


def test_nothing_free_is_no_share():
    unknown = OccupancyGrid(np.zeros((3, 3), np.float32), 0.05, np.zeros(3))
    assert common_free(unknown, unknown, se2.IDENTITY).share == 0.0
