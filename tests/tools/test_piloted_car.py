"""What comes of each command: recorded, kept, and the end of the drive told from an interruption."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from drivers.emulated_link import SimulatedClock
from drivers.messages import PlannedPath, Recordable, VelocityCommand
from drivers.vehicle import DriveCommand, NullVehicle
from mapping.mount import Mount
from mapping.relocalisation import Located
from planning.path import path_along
from planning.safety import SafetyStage, Stamps
from tools.autopilot import AutopilotState, Drive
from tools.drive_log import Outcome
from tools.piloted_car import PilotedCar
from tools.session_parts import LiveSession

AHEAD = DriveCommand(0.4, 0.5)
GOALS = [np.array([1.0, 0.0, 0.0])]


class StraightOn:
    """A pilot that drives one command along one path; its state is what the test says."""

    def __init__(self):
        self.safety, self.state = SafetyStage(), AutopilotState.driving
        self.goal_number = 0
        self.place = Located(0, np.array([0.97, 0.0, 0.0]), np.zeros(3), np.eye(3), 1.0, "")
        line = np.column_stack([np.linspace(0.0, 1.0, 50), np.zeros(50), np.zeros(50)])
        self.drives, self.notes = [Drive(5.5, path_along(line), "set out")], [(5.2, "a note")]

    def tick(self, now_s):
        return self.safety.step(AHEAD, Stamps(now_s, now_s, now_s), now_s)

    def status(self, now_s):
        return f"{self.state.value} at {now_s:.0f} s"


@pytest.fixture
def bench():
    """A pilot, its car with no vehicle, the clock, and what was recorded."""
    clock, pilot = SimulatedClock(5_000_000_000), cast("Any", StraightOn())
    recorded: list[Recordable] = []
    session = LiveSession(clock, Mount(), recorded.append, threading.Event())
    car = PilotedCar(pilot, NullVehicle(clock), GOALS, session, 10.0)
    return pilot, car, clock, recorded


def drive(car, clock, seconds):
    """Step at 50 Hz; return whether the drive was over in the end."""
    over = False
    for _ in range(round(seconds / 0.02)):
        car.step(clock())
        over = car.look(clock())
        clock.sleep(0.02)
    return over


def test_commands_are_recorded_at_the_pilots_pace_and_the_path_once(bench):
    _, car, clock, recorded = bench
    assert not drive(car, clock, 1.0)
    commands = [message for message in recorded if isinstance(message, VelocityCommand)]
    assert 18 <= len(commands) <= 22
    assert commands[-1].yaw_rate_radps == pytest.approx(0.4 * 0.5)
    (path,) = (message for message in recorded if isinstance(message, PlannedPath))
    assert path.poses[-1].tolist() == pytest.approx([1.0, 0.0, 0.0])
    report = car.report()
    assert [(each["at_s"], each["reason"]) for each in report["paths"]] == [(0.5, "set out")]
    assert report["notes"] == [{"at_s": 0.2, "text": "a note"}]
    assert "it would be told 0.40 m/s, curvature 0.50/m" in car.status()


@pytest.mark.parametrize(
    ("state", "outcome"),
    [
        (AutopilotState.arrived, Outcome.arrived),
        (AutopilotState.no_way, Outcome.no_way),
        (AutopilotState.driving, Outcome.interrupted),
    ],
)
def test_the_drive_is_over_where_the_pilot_is_done(bench, state, outcome):
    pilot, car, clock, _ = bench
    drive(car, clock, 0.5)
    pilot.state = state
    assert drive(car, clock, 0.2) is (outcome is not Outcome.interrupted)
    assert car.conclusion(None)[0] is outcome
    assert car.report()["arrived"] == (outcome is Outcome.arrived)


def test_a_car_that_does_not_know_its_place_is_given_up_after_a_while(bench):
    pilot, car, clock, _ = bench
    pilot.state = AutopilotState.lost
    assert not drive(car, clock, 9.0)
    assert drive(car, clock, 2.0)
    outcome, reason = car.conclusion(None)
    assert outcome is Outcome.lost
    assert "not known for 10 s" in reason


def test_a_car_whose_place_is_old_is_given_up_likewise(bench):
    """Scans come and none fits: the pilot goes on believing in the last place, and stands."""
    pilot, car, clock, _ = bench
    pilot.place = replace(pilot.place, stamp_ns=clock())
    assert not drive(car, clock, 9.0)
    assert drive(car, clock, 2.0)
    assert car.conclusion(None)[0] is Outcome.lost


def test_our_emergency_stop_is_no_fault_of_the_vehicle_and_the_session_goes_on(bench):
    pilot, car, clock, _ = bench
    drive(car, clock, 0.5)
    car.emergency_stop("by a key")
    pilot.state = AutopilotState.arrived  # whatever it thinks
    assert not drive(car, clock, 5.0)
    pilot.state = AutopilotState.driving
    assert car.conclusion(None) == (Outcome.emergency, "by a key")
    assert car.fault == ""
    assert pilot.tick(clock() * 1e-9).stopped


def test_what_the_thread_died_of_comes_first(bench):
    _, car, clock, _ = bench
    drive(car, clock, 0.2)
    assert car.conclusion(ZeroDivisionError("by zero")) == (Outcome.failed, "ZeroDivisionError: by zero")
