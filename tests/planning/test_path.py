"""Gears, cusps and speeds along poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planning.errors import PlanningError
from planning.path import SpeedLimits, path_along


def line(length_m: float, yaw: float = 0.0) -> np.ndarray:
    along = np.arange(0.0, length_m + 1e-9, 0.01)
    return np.column_stack([np.cos(yaw) * along, np.sin(yaw) * along, np.full(len(along), yaw)])


def there_and_back() -> np.ndarray:
    """1 m ahead and 0.5 m back, the pose of the cusp once."""
    along = np.concatenate([np.arange(0.0, 1.001, 0.01), np.arange(0.99, 0.495, -0.01)])
    return np.column_stack([along, np.zeros((len(along), 2))])


def test_a_long_straight_way_is_driven_at_top_speed_and_to_a_stop():
    path = path_along(line(4.0, 0.4))
    assert path.length_m == pytest.approx(4.0)
    assert path.speed_mps.max() == SpeedLimits().top_mps
    assert path.speed_mps[-1] == 0.0
    assert set(path.direction.tolist()) == {1}
    assert path.cusps.size == 0


def test_against_its_heading_the_car_drives_backwards():
    poses = line(1.0)
    poses[:, 2] = np.pi
    assert set(path_along(poses).direction.tolist()) == {-1}


def test_a_turn_is_driven_slower_than_a_straight():
    angles = np.arange(0.0, 2.0 * np.pi, 0.01 / 0.45)
    circle = np.column_stack([0.45 * np.sin(angles), 0.45 * (1.0 - np.cos(angles)), angles])
    fastest = path_along(circle).speed_mps.max()
    assert fastest == pytest.approx(np.sqrt(0.5 * 0.45), rel=0.01)


@pytest.mark.parametrize("count", [1, 2])
def test_the_shortest_paths_have_a_speed_too(count):
    path = path_along(line(1.0)[:count])
    assert len(path.direction) == len(path.speed_mps) == count
    assert path.speed_mps[-1] == 0.0


def test_the_car_creeps_at_the_cusp_and_nowhere_else_on_the_way():
    path = path_along(there_and_back())
    assert path.cusps.tolist() == [100]
    assert path.direction[[0, 99, 100, -1]].tolist() == [1, 1, -1, -1]
    slow = np.flatnonzero(path.speed_mps <= SpeedLimits().creep_mps)
    assert slow.tolist() == [0, 100, 150]
    assert path.length_m == pytest.approx(1.5)


def test_a_pose_given_twice_changes_no_gear():
    poses = line(1.0)
    poses[:, 2] = np.pi
    doubled = np.repeat(poses, [3 if i in {0, 40, 100} else 1 for i in range(101)], axis=0)
    assert set(path_along(doubled).direction.tolist()) == {-1}
    assert path_along(doubled).length_m == pytest.approx(1.0)


def test_gears_of_the_planner_are_taken_as_they_are():
    poses = there_and_back()
    gears = np.ones(len(poses), np.int8)
    gears[100:] = -1
    known, guessed = path_along(poses, gears), path_along(poses)
    np.testing.assert_array_equal(known.direction, guessed.direction)
    np.testing.assert_array_equal(known.speed_mps, guessed.speed_mps)
    # A cusp that is sampled on one side only is seen in its gears, not in its poses.
    jump = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0]])
    assert path_along(jump, np.array([1, -1, 1, 1], np.int8)).cusps.tolist() == [1, 2]
    with pytest.raises(ValueError, match="expected"):
        path_along(poses, gears[1:])


@given(st.lists(st.floats(-0.01, 0.01), min_size=1, max_size=200), st.floats(0.05, 2.0))
def test_no_speed_needs_more_acceleration_than_allowed(steps, acceleration):
    poses = np.zeros((len(steps) + 1, 3))
    poses[1:, 0] = np.cumsum(steps)
    limits = SpeedLimits(acceleration_mps2=acceleration)
    path = path_along(poses, limits=limits)
    assert (path.speed_mps >= 0.0).all()
    assert path.speed_mps.max() <= limits.top_mps
    assert path.speed_mps[path.cusps].max(initial=0.0) <= limits.creep_mps
    rise = np.abs(np.diff(path.speed_mps**2))
    assert (rise <= 2.0 * acceleration * np.abs(np.diff(poses[:, 0])) + 1e-9).all()


def test_speed_limits_change_the_speed_and_not_the_way():
    path = path_along(there_and_back())
    faster = path.at_speed(SpeedLimits(top_mps=1.0, acceleration_mps2=1.0))
    assert faster.speed_mps.max() > path.speed_mps.max()
    np.testing.assert_array_equal(faster.poses, path.poses)
    np.testing.assert_array_equal(faster.direction, path.direction)


@pytest.mark.parametrize(
    "bad", [{"top_mps": 0.0}, {"lateral_mps2": np.nan}, {"acceleration_mps2": -1.0}, {"creep_mps": 0.6}]
)
def test_impossible_limits_are_refused(bad):
    with pytest.raises(PlanningError, match=f"speed: {next(iter(bad))}"):
        SpeedLimits(**bad)


def test_the_message_holds_the_poses_with_their_stamp():
    path = path_along(there_and_back())
    message = path.to_message(17, "global")
    assert (message.stamp_ns, message.frame_id) == (17, "global")
    np.testing.assert_array_equal(message.poses, path.poses)
