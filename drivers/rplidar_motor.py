"""Who turns an RPLIDAR's head: the USB accessory board, a modem line of the port, or somebody else.

On a bare UART (the lidar's four data and supply wires plus MOTOCTL, as on a car's computer board) there is no accessory
board: the question for it meets silence, and MOTOCTL hangs on a modem line or is driven by other means. MOTOCTL low
stops the motor, and so does an asserted line, which is low on a 3.3 V UART and "stop" on an A1's adapter.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from drivers.rplidar_channel import RplidarChannel
from drivers.rplidar_protocol import PWM_SUPPORTED, Answer, accessory_flag_request, pwm_request

_SETTLE_S = 0.01  # after a new duty


class MotorControl(str, Enum):
    """How the motor is switched; AUTO: by the accessory board if it answers, else by DTR."""

    AUTO = "auto"
    DTR = "dtr"
    RTS = "rts"
    EXTERNAL = "external"


class LidarMotor:
    """Switches the motor; the way is found out on the first start."""

    def __init__(self, channel: RplidarChannel, control: MotorControl, sleep: Callable[[float], None]) -> None:
        self.control = control
        self._channel = channel
        self._sleep = sleep
        self._board: bool | None = None
        self._started = False

    def has_board(self) -> bool:
        """Whether an accessory board answers that drives the motor; asked once, and only if it may be there."""
        if self._board is None:
            self._board = self.control == MotorControl.AUTO and self._ask_board()
        return self._board

    def start(self, pwm: int) -> None:
        """Turn at a duty of 0 to 1023; a line knows only full speed. ValueError for another duty."""
        wanted = pwm_request(pwm)
        self._started = True
        self._set_line(stop=pwm == 0 and not self.has_board())
        if self.has_board():
            self._channel.link.write(wanted)
            self._sleep(_SETTLE_S)

    def stop(self) -> None:
        """Stop what start() turned; a motor that was never started here is left as it is."""
        if not self._started:
            return
        if self.has_board():
            self._sleep(_SETTLE_S)
            self._channel.link.write(pwm_request(0))
        else:
            self._set_line(stop=True)

    def _ask_board(self) -> bool:
        flags = self._channel.ask(accessory_flag_request(), Answer.ACC_BOARD_FLAG, 4, attempts=2)
        return flags is not None and bool(flags[0] & PWM_SUPPORTED)

    def _set_line(self, *, stop: bool) -> None:
        if self.control == MotorControl.RTS:
            self._channel.link.set_rts(stop)
        elif self.control != MotorControl.EXTERNAL:
            self._channel.link.set_dtr(stop)
