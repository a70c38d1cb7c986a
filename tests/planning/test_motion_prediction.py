"""The prediction against the simulated car itself: same commands, same way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.rover_dynamics import RoverDynamics, RoverModel
from drivers.vehicle import DriveCommand
from mapping import se2
from planning.errors import PlanningError
from planning.motion_prediction import MotionModel, MotionPrediction

TICK_S = 0.05


def drive(commands, latency_s=0.1):
    """Live through commands, one each tick; return the prediction and the true states by time."""
    start = np.array([1.0, -2.0, 2.0])
    car, prediction = RoverDynamics(start, RoverModel(latency_s=latency_s)), MotionPrediction(MotionModel(latency_s))
    states = {0.0: car.state}
    for number, command in enumerate(commands):
        prediction.tell(number * TICK_S, command)
        states[round((number + 1) * TICK_S, 3)] = car.step(TICK_S, command)
    return prediction, states


def weaving(count):
    return [DriveCommand(0.4 * math.sin(n / 15.0), 1.5 * math.cos(n / 9.0)) for n in range(count)]


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.25])
@pytest.mark.parametrize("stamp_s", [2.0, 1.5, 1.83])
def test_an_old_pose_becomes_the_present_one(latency_s, stamp_s):
    prediction, states = drive(weaving(50), latency_s)
    before = states[round(math.floor(stamp_s / TICK_S + 1e-9) * TICK_S, 3)].pose
    seen = before if stamp_s != 1.83 else prediction.pose_at(before, 1.8, stamp_s)
    now = prediction.pose_at(seen, stamp_s, 2.4)
    off = se2.between(states[2.4].pose, now)
    assert np.hypot(off[0], off[1]) < 0.002
    assert abs(off[2]) < 0.01
    assert prediction.speed_mps(2.4) == pytest.approx(states[2.4].speed_mps, abs=0.01)


def test_the_pose_at_which_a_command_takes_hold_is_known_when_it_is_given():
    prediction, states = drive(weaving(40))  # the last command was given at 1.95 s
    later = prediction.pose_at(states[1.5].pose, 1.5, 2.0)
    np.testing.assert_allclose(later[:2], states[2.0].pose[:2], atol=0.002)


def test_a_car_that_was_told_nothing_stands():
    prediction = MotionPrediction()
    pose = np.array([3.0, 4.0, 1.0])
    np.testing.assert_array_equal(prediction.pose_at(pose, 5.0, 6.0), pose)
    assert prediction.speed_mps(6.0) == 0.0


def test_a_model_without_sense_is_refused():
    with pytest.raises(PlanningError, match="acceleration_mps2 is 0"):
        MotionModel(acceleration_mps2=0.0)
    with pytest.raises(PlanningError, match="latency_s is nan"):
        MotionModel(latency_s=math.nan)
