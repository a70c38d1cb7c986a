from __future__ import annotations

from tools.autopilot import AutopilotState
from tools.drive_warm_up import warm_up_drive


def test_the_made_up_car_gets_as_far_as_driving():
    assert warm_up_drive() is AutopilotState.driving
