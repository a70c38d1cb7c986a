"""How a live stop is measured and judged; the trials themselves take minutes: `evaluate drives --live`."""

from __future__ import annotations

import math

import pytest

from drivers.rover_dynamics import RoverModel
from tools.drive_scores import Stop
from tools.live_drive_trials import LiveCause, in_time, table_of_live

CAR = RoverModel()
BRAKES_S = CAR.latency_s + 0.5 / CAR.acceleration_mps2


@pytest.mark.parametrize(
    ("cause", "command_s", "stood_s", "good"),
    [
        (LiveCause.emergency, 0.05, 0.05 + BRAKES_S, True),
        (LiveCause.emergency, 0.61, 0.61 + BRAKES_S, False),  # told too late
        (LiveCause.silent_lidar, 0.5, 1.2, False),  # braked too late
        (LiveCause.interrupt, math.inf, 0.4, False),  # nobody told it
        (LiveCause.interrupt, 0.1, math.inf, False),  # it never stood
        (LiveCause.killed, math.inf, 3.0 + BRAKES_S, True),
        (LiveCause.cut, math.inf, 3.3 + BRAKES_S, False),  # later than its own timeout
    ],
)
def test_a_stop_is_judged_by_who_can_stop_the_car(cause, command_s, stood_s, good):
    assert in_time(Stop(command_s, stood_s, 0.5, 0.5), cause, 3.0, CAR) is good


def test_the_table_has_a_line_for_each_cause_with_the_worst():
    rows = [
        {"cause": cause.value, "passed": number == 0, "contacts": 0, "command_s": 0.1 * number, "stood_s": 0.5 + number}
        | ({"goal_m": 0.01 * number, "goal_deg": 2.0} if cause is LiveCause.arrival else {})
        for cause in LiveCause
        for number in range(2)
    ]
    lines = table_of_live({"each": 2, "rows": rows})
    assert "simulated" in lines[0]
    assert len(lines) == 1 + len(LiveCause)
    assert any(
        "e-stop" in line and "1 of 2; at most zero speed after 0.100 s, standing after 1.50 s" in line for line in lines
    )
    assert any("SIGKILL" in line and "at most standing after 1.50 s" in line for line in lines)
