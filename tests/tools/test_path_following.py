"""One path with things on it: the car is told to stand before them, and goes on braking on its path."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.follower import FollowerStatus
from planning.path import path_along
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.path_following import Following

CAR = Vehicle(margin_m=0.0)
NOSE_M = 0.3405
START = np.array([1.0, 2.0, 0.0])


def by(x, y, yaw):
    return np.array([x, y, yaw])


def room(wall=None):
    """6 m x 4 m at 0.05 m, free but for some cells."""
    cells = np.full((80, 120), -5.0, np.float32)
    if wall is not None:
        cells[wall] = 5.0
    return costmap(OccupancyGrid(cells, 0.05, np.zeros(3)), CAR, UnknownSpace.forbidden)


def straight(length_m=3.0, gear=1):
    x = START[0] + gear * np.arange(0.0, length_m, 0.01)
    return path_along(np.column_stack([x, np.full(len(x), 2.0), np.zeros(len(x))]))


def driven(following, near, seconds=20.0, pose=START):
    """Let a car without delay drive; returns its poses."""
    poses, speed = [pose], 0.0
    for n in range(round(seconds / 0.05)):
        step = following.step(near, poses[-1], speed, 0.05 * n)
        speed, turn = step.command.speed_mps, step.command.yaw_rate_radps * 0.05
        x, y, yaw = poses[-1]
        poses.append(np.array([x + speed * 0.05 * np.cos(yaw), y + speed * 0.05 * np.sin(yaw), yaw + turn]))
        if step.status in (FollowerStatus.arrived, FollowerStatus.blocked, FollowerStatus.off_path):
            break
    return np.array(poses)


@pytest.mark.parametrize("gear", [1, -1])
def test_a_free_path_is_driven_to_its_end(gear):
    start = START if gear > 0 else START + by(3.5, 0.0, 0.0)
    path = straight(2.0) if gear > 0 else path_along(straight(2.0, -1).poses + by(3.5, 0.0, 0.0))
    following = Following(path, AutopilotSettings())
    poses = driven(following, room(), pose=start)
    assert following.last.status is FollowerStatus.arrived
    assert not following.blocked
    np.testing.assert_allclose(poses[-1], path.poses[-1], atol=0.02)


def test_what_stands_on_the_path_is_told_with_how_far_it_is():
    following = Following(straight(), AutopilotSettings())
    step = following.step(room(np.s_[38:43, 60:64]), START, 0.4, 0.0)  # from x = 3 m on
    assert step.status is FollowerStatus.blocked
    assert step.command.speed_mps == 0.0
    assert following.blocked == "something on the path, 1.7 m ahead"
    assert following.step(room(), START, 0.0, 0.1).status is FollowerStatus.blocked  # it stays so
    assert following.braking(START, 0.3, 0.2).speed_mps == 0.0


def test_what_is_farther_than_it_looks_does_not_stop_it_yet():
    following = Following(straight(4.0), AutopilotSettings(check_m=1.0))
    near = room(np.s_[38:43, 60:64])
    assert following.step(near, START, 0.4, 0.0).status is FollowerStatus.driving
    poses = driven(following, near)
    assert following.blocked
    assert poses[-1][0] < 3.0 - NOSE_M


def test_beside_its_path_it_looks_where_it_is_going_to_drive():
    beside = START + by(0.5, -0.12, 0.0)  # the wall is where the car is, not where its path is
    near = room(np.s_[36:37, 38:44])  # y 1.8 to 1.85 m, from x = 1.9 m on
    following = Following(straight(), AutopilotSettings(check_m=0.01))
    poses = driven(following, near, pose=beside)
    assert following.blocked.startswith("contact in")
    assert poses[-1][0] + NOSE_M < 1.9


def test_far_beside_the_path_it_stands_and_says_so():
    following = Following(straight(), AutopilotSettings())
    step = following.step(room(), START + by(0.5, 0.4, 0.0), 0.4, 0.0)
    assert step.status is FollowerStatus.off_path
    assert "beside the path" in following.blocked


def test_what_is_driven_of_the_path_is_known():
    following = Following(straight(), AutopilotSettings())
    assert following.driven is None
    following.step(room(), START + by(0.4, 0.0, 0.0), 0.4, 0.0)
    assert following.driven is not None
    np.testing.assert_allclose(following.driven.poses[[0, -1]], [START, START + by(0.4, 0.0, 0.0)], atol=0.011)
