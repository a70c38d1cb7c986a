"""Which way the motor is switched; tests/drivers/test_rplidar.py does so on whole sensors."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.rplidar_channel import RplidarChannel
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from drivers.rplidar_motor import LidarMotor, MotorControl


class Wired:
    """A motor on an emulated sensor, and the states of its lines."""

    def __init__(self, control: MotorControl, *, board: bool) -> None:
        clock = SimulatedClock()
        device = RplidarEmulator(A2M8, lambda _times, theta: np.ones(len(theta)), board=board)
        self.lines: dict[str, bool] = {}
        link = EmulatedLink(device, clock, 115200, 115200, on_line=self.lines.__setitem__)
        self.motor = LidarMotor(RplidarChannel(link, clock, clock.sleep), control, clock.sleep)


@pytest.mark.parametrize("board", [True, False])
def test_only_auto_asks_for_the_board(board: bool) -> None:
    assert Wired(MotorControl.AUTO, board=board).motor.has_board() == board
    for control in (MotorControl.DTR, MotorControl.RTS, MotorControl.EXTERNAL):
        assert not Wired(control, board=board).motor.has_board()


@pytest.mark.parametrize(("control", "line"), [(MotorControl.DTR, "dtr"), (MotorControl.RTS, "rts")])
def test_an_asserted_line_stops(control: MotorControl, line: str) -> None:
    wired = Wired(control, board=False)
    states = []
    for pwm in (660, 0, 1023):
        wired.motor.start(pwm)
        states.append(wired.lines[line])
    wired.motor.stop()
    assert [*states, wired.lines[line]] == [False, True, False, True]


def test_a_motor_that_was_not_started_is_left_alone() -> None:
    for control in MotorControl:
        wired = Wired(control, board=False)
        wired.motor.stop()
        assert wired.lines == {}


def test_a_duty_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="1024"):
        Wired(MotorControl.AUTO, board=True).motor.start(1024)
