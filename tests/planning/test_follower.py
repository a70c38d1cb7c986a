"""Drives of the simulated car along paths: near the path, at the goal, with a stop wherever the gear changes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.rover_dynamics import RoverDynamics, RoverModel
from drivers.vehicle import DriveCommand
from mapping import se2
from planning.errors import PlanningError
from planning.follower import Follower, FollowerSettings, FollowerStatus
from planning.motion_prediction import MotionPrediction
from planning.path import path_along

RADIUS_M = 0.576


def arcs(*pieces, start=(0.0, 0.0, 0.4)):
    """Poses a centimetre apart and gears along pieces of (length in m, negative backwards; curvature in 1/m)."""
    poses, gears = [np.array(start)], []
    for length_m, curvature in pieces:
        count = round(abs(length_m) / 0.01)
        for _ in range(count):
            step = length_m / count
            poses.append(se2.compose(poses[-1], se2.exp(np.array([step, 0.0, step * curvature]))))
            gears.append(1 if length_m > 0 else -1)
    return np.array(poses), np.array([*gears, gears[-1]], np.int8)


PATHS = {
    "straight": [(3.0, 0.0)],
    "s": [(0.8, 0.0), (1.0, 1 / RADIUS_M), (1.2, -1 / RADIUS_M), (0.8, 0.0)],
    "backwards": [(-0.5, 0.0), (-1.2, 1 / RADIUS_M), (-0.8, -1 / RADIUS_M), (-0.5, 0.0)],
    "cusps": [(0.9, 1 / RADIUS_M), (-0.9, -1 / RADIUS_M), (1.2, 0.0)],
}


def drive(path, start=None, latency_s=0.1, seconds=60.0):
    """Follow with the true pose at 20 Hz; return the last step, true poses (N, 3), speeds (N,) and statuses."""
    car = RoverDynamics(path.poses[0] if start is None else start, RoverModel(latency_s=latency_s))
    follower, prediction = Follower(path), MotionPrediction()
    poses, speeds, statuses = [car.state.pose], [0.0], []
    for tick in range(round(seconds / 0.05)):
        now_s = 0.05 * tick
        soon = now_s + 0.1
        pose = prediction.pose_at(car.state.pose, now_s, soon)
        step = follower.step(pose, prediction.speed_mps(soon), now_s)
        prediction.tell(now_s, step.command)
        statuses.append(step.status)
        if step.status in (FollowerStatus.arrived, FollowerStatus.off_path):
            break
        state = car.step(0.05, step.command)
        poses.append(state.pose)
        speeds.append(state.speed_mps)
    return step, np.array(poses), np.array(speeds), statuses


def farthest_m(path, poses):
    return max(float(np.hypot(*(path.poses[:, :2] - pose[:2]).T).min()) for pose in poses)


@pytest.mark.parametrize("name", list(PATHS))
@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.25])
def test_the_car_keeps_to_the_path_and_arrives(name, latency_s):
    path = path_along(*arcs(*PATHS[name]))
    step, poses, _, _ = drive(path, latency_s=latency_s)
    assert step.status is FollowerStatus.arrived
    assert farthest_m(path, poses) < 0.04
    off = se2.between(path.poses[-1], poses[-1])
    assert np.hypot(off[0], off[1]) < 0.03
    assert abs(off[2]) < math.radians(6.0)
    assert step.remaining_m == 0.0


def test_the_gear_changes_where_the_path_has_its_cusps_and_the_car_stands_there():
    path = path_along(*arcs(*PATHS["cusps"]))
    _, poses, speeds, statuses = drive(path)
    assert statuses.count(FollowerStatus.cusp) >= 2
    signs = np.sign(np.where(np.abs(speeds) < 0.005, 0.0, speeds))
    moving = signs[signs != 0]
    assert np.count_nonzero(np.diff(moving)) == 2
    for cusp in path.cusps:
        nearest = poses[np.argmin(np.hypot(*(poses[:, :2] - path.poses[cusp, :2]).T))]
        assert np.hypot(*(nearest - path.poses[cusp])[:2]) < 0.03
    standing = np.flatnonzero(signs == 0)
    assert len(standing) > 2 * 0.4 / 0.05


def test_the_speed_is_the_paths_and_less_in_curves_and_near_things():
    straight, bent = path_along(*arcs((3.0, 0.0))), path_along(*arcs((3.0, 1 / RADIUS_M)))
    for path, clearance_m, most in ((straight, math.inf, 0.5), (straight, 0.075, 0.25), (bent, math.inf, 0.32)):
        middle = path.poses[150]
        follower = Follower(path, FollowerSettings(window_m=5.0))
        step = follower.step(middle, 0.4, 0.0, clearance_m)
        assert step.command.speed_mps == pytest.approx(most, abs=0.01)


def test_the_carrot_lies_behind_a_car_that_reverses():
    path = path_along(*arcs((-2.0, 0.0), start=(0.0, 0.0, 0.0)))
    step = Follower(path).step(np.array([-0.5, 0.05, 0.0]), -0.3, 0.0)
    assert step.command.speed_mps < 0.0
    # Left of the line with the nose ahead: going back to it, the tail must swing right, so the car turns left.
    assert step.command.curvature_1pm < 0.0
    assert step.cross_track_m == pytest.approx(-0.05)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_beside_the_path_comes_back_to_it(side):
    path = path_along(*arcs((4.0, 0.0), start=(0.0, 0.0, 0.0)))
    step, poses, _, _ = drive(path, start=np.array([0.0, 0.2 * side, 0.1]))
    assert step.status is FollowerStatus.arrived
    assert abs(poses[-1, 1]) < 0.02


def test_a_car_that_cannot_be_on_its_way_stops():
    path = path_along(*arcs((4.0, 0.0), start=(0.0, 0.0, 0.0)))
    for pose, words in (((1.0, 0.5, 0.0), "beside"), ((1.0, 0.0, 1.5), "turned by 86 deg")):
        step = Follower(path, FollowerSettings(window_m=5.0)).step(np.array(pose), 0.3, 0.0)
        assert step.status is FollowerStatus.off_path
        assert step.command.speed_mps == 0.0
        assert words in step.reason


def test_a_path_that_crosses_itself_is_driven_in_order():
    path = path_along(*arcs((0.6, 0.0), (2 * math.pi * RADIUS_M, 1 / RADIUS_M), (0.6, 0.0)))
    step, poses, _, _ = drive(path)
    driven = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    assert step.status is FollowerStatus.arrived
    assert driven == pytest.approx(path.length_m, rel=0.03)


def test_what_lies_ahead_begins_at_the_car():
    path = path_along(*arcs((2.0, 0.0), start=(0.0, 0.0, 0.0)))
    follower = Follower(path, FollowerSettings(window_m=5.0))
    follower.step(np.array([0.5, 0.0, 0.0]), 0.3, 0.0)
    ahead = follower.ahead(1.0)
    assert ahead[0, 0] == pytest.approx(0.5, abs=0.011)
    assert ahead[-1, 0] == pytest.approx(1.5, abs=0.011)


def test_a_blocked_step_stands_with_the_wheels_as_they_were():
    path = path_along(*arcs((2.0, 0.0)))
    step = Follower(path).step(path.poses[0], 0.0, 0.0)
    blocked = step.blocked("a box")
    assert blocked.command == DriveCommand(0.0, step.command.curvature_1pm)
    assert (blocked.status, blocked.reason) == (FollowerStatus.blocked, "a box")


def test_a_path_of_one_pose_is_driven_already():
    follower = Follower(path_along(np.array([[1.0, 2.0, 0.3]])))
    assert follower.step(np.array([1.0, 2.0, 0.3]), 0.0, 0.0).status is FollowerStatus.arrived


def test_settings_without_sense_are_refused():
    with pytest.raises(PlanningError, match="least_lookahead_m"):
        FollowerSettings(least_lookahead_m=1.0)
    with pytest.raises(PlanningError, match="near_m is 0"):
        FollowerSettings(near_m=0.0)
    with pytest.raises(PlanningError, match="without poses"):
        Follower(path_along(np.zeros((0, 3))))


@pytest.mark.parametrize("name", list(PATHS))
def test_the_way_that_is_foretold_is_the_way_that_is_driven(name):
    path = path_along(*arcs(*PATHS[name]))
    _, driven, _, _ = drive(path)
    follower = Follower(path)
    before = follower.progress_m
    way = follower.way(path.poses[0], 0.05, 0.6)
    assert follower.progress_m == before
    assert len(way) > 25
    assert max(float(np.hypot(*(driven[:, :2] - pose[:2]).T).min()) for pose in way) < 0.02
