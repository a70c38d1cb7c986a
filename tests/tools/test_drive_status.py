from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.vehicle import DriveCommand
from planning.safety import SafeCommand
from tools.drive_status import AutopilotState, Situation, words_of

DRIVING = Situation(
    AutopilotState.driving, 0, 2, remaining_m=3.42, place="97% of 300 points on walls", planning="no path from here",
    by_odometry=False, safe=SafeCommand(DriveCommand(0.48, 0.3)), emergency="",
)  # fmt: skip


def test_driving_tells_goal_way_and_speed():
    assert words_of(DRIVING) == "driving to goal 1 of 2: 3.4 m to go, 0.48 m/s"
    assert words_of(replace(DRIVING, goals=1)).startswith("driving to goal 1: ")
    assert "by odometry only: 97%" in words_of(replace(DRIVING, by_odometry=True))


def test_backing_off_tells_that_it_goes_backwards():
    now = replace(DRIVING, state=AutopilotState.backing_off, safe=SafeCommand(DriveCommand(-0.2, 0.0)))
    assert words_of(now) == "backing off, to plan again to goal 1 of 2: 3.4 m to go, 0.20 m/s backwards"


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (AutopilotState.locating, DRIVING.place),
        (AutopilotState.lost, DRIVING.place),
        (AutopilotState.planning, DRIVING.planning),
        (AutopilotState.no_way, DRIVING.planning),
    ],
)
def test_a_car_that_stands_tells_why(state, reason):
    words = words_of(replace(DRIVING, state=state))
    assert reason in words
    assert " m to go" not in words


def test_each_state_has_words_of_its_own():
    assert len({words_of(replace(DRIVING, state=state)) for state in AutopilotState}) == len(AutopilotState)


def test_what_the_last_stage_stops_is_not_called_driving():
    stopped = SafeCommand(DriveCommand(0.0, 0.0), "the last scan is 0.70 s old, 0.5 s are allowed", stopped=True)
    assert words_of(replace(DRIVING, safe=stopped)) == f"standing on the way to goal 1 of 2: {stopped.reason}"


def test_an_emergency_stop_goes_before_all():
    for state in AutopilotState:
        assert words_of(replace(DRIVING, state=state, emergency="pressed")) == "emergency stop: pressed"
