"""The last stage: never faster than allowed, never on old data, and an emergency stop holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.vehicle import DriveCommand
from planning.errors import PlanningError
from planning.safety import SafetyLimits, SafetyStage, Stamps

LIMITS = SafetyLimits()
FORWARD = DriveCommand(0.4, 0.5)
NUMBERS = st.floats(-5.0, 5.0)


def fresh(now_s):
    return Stamps(now_s, now_s, now_s)


def rolling(limits=LIMITS, until_s=2.0):
    """A stage that has let the car drive for a while."""
    stage = SafetyStage(limits)
    for now_s in np.arange(0.0, until_s, 0.05):
        stage.step(FORWARD, fresh(now_s), float(now_s))
    return stage


@given(st.lists(st.tuples(NUMBERS, NUMBERS, st.floats(0.01, 0.2)), min_size=1, max_size=30))
def test_limits_hold_whatever_is_wanted(wishes):
    stage, now_s, last = SafetyStage(), 0.0, 0.0
    for speed, curvature, tick_s in wishes:
        now_s += tick_s
        safe = stage.step(DriveCommand(speed, curvature), fresh(now_s), now_s).command
        assert abs(safe.speed_mps) <= min(abs(speed), LIMITS.speed_mps)
        assert safe.speed_mps * speed >= 0.0
        assert abs(safe.curvature_1pm) <= LIMITS.curvature_1pm
        assert abs(safe.speed_mps) - abs(last) <= LIMITS.acceleration_mps2 * tick_s + 1e-9
        last = safe.speed_mps


def test_what_is_harmless_passes_unchanged_and_without_words():
    step = rolling().step(FORWARD, fresh(2.0), 2.0)
    assert step.command == FORWARD
    assert (step.reason, step.stopped) == ("", False)


def test_braking_is_never_held_back():
    assert rolling().step(DriveCommand(0.0, 0.0), fresh(2.0), 2.0).command.speed_mps == 0.0


@pytest.mark.parametrize("name", ["pose", "scan", "command"])
def test_old_data_stop_the_car_when_their_time_is_over_and_not_before(name):
    limit_s = getattr(LIMITS, f"{name}_age_s")
    stage = rolling()
    for age_s, stopped in ((limit_s - 0.01, False), (limit_s + 0.01, True)):
        now_s = 2.0 + age_s
        stamps = dict.fromkeys(("pose_s", "scan_s", "command_s"), now_s) | {f"{name}_s": 2.0}
        step = stage.step(FORWARD, Stamps(**stamps), now_s)
        assert step.stopped is stopped
        assert (step.command.speed_mps == 0.0) is stopped
    assert f"the last {name} is" in step.reason
    assert step.command.curvature_1pm == FORWARD.curvature_1pm  # the wheels stay as they are


def test_the_car_goes_on_gently_when_fresh_data_come():
    stage = rolling()
    assert stage.step(FORWARD, Stamps(0.0, 2.0, 2.0), 2.0).stopped
    step = stage.step(FORWARD, fresh(2.05), 2.05)
    assert not step.stopped
    assert step.command.speed_mps == pytest.approx(LIMITS.acceleration_mps2 * 0.05)


@pytest.mark.parametrize("stamp_s", [None, math.nan, math.inf, 100.0])
def test_no_stamp_and_a_senseless_one_stop_the_car(stamp_s):
    assert rolling().step(FORWARD, Stamps(2.0, stamp_s, 2.0), 2.0).stopped


def test_an_emergency_stop_holds_until_it_is_released():
    stage = rolling()
    stage.emergency_stop("the user pressed it")
    stage.emergency_stop("again")
    for now_s in (2.0, 2.5, 60.0):
        step = stage.step(FORWARD, fresh(now_s), now_s)
        assert step.stopped
        assert step.command.speed_mps == 0.0
        assert step.reason == "emergency stop: the user pressed it"
    stage.release()
    assert not stage.step(FORWARD, fresh(60.1), 60.1).stopped


def test_limits_without_sense_are_refused():
    with pytest.raises(PlanningError, match="pose_age_s is 0"):
        SafetyLimits(pose_age_s=0.0)


def test_a_hold_lasts_as_long_as_its_reason_and_is_no_emergency_stop():
    stage = rolling()
    stage.hold("the vehicle is not ready")
    held = stage.step(FORWARD, fresh(2.0), 2.0)
    assert (held.command.speed_mps, held.reason, held.stopped) == (0.0, "the vehicle is not ready", True)
    stage.emergency_stop("pressed")
    stage.hold("")
    assert stage.step(FORWARD, fresh(2.05), 2.05).stopped
    stage.release()
    assert stage.step(FORWARD, fresh(2.1), 2.1).command.speed_mps > 0.0
