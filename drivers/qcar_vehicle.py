"""A Quanser QCar through Quanser's own Python API. NEVER RUN ON HARDWARE: tested against a fake of the calls it makes.

The calls, as in Quanser_Academic_Resources, pal/products/qcar.py: QCar(readMode, pwmLimit), read(), write(throttle,
steering), terminate(), and the attributes motorEncoder, gyroscope, accelerometer, batteryVoltage after a read. That
API prints faults of the board instead of raising them, so a board that is not there is told by a battery of 0 V.

The throttle is a duty cycle, so speed is controlled here, in poll(), from the encoder. The board is owned by a process
of its own (drivers.qcar_guard), which stops the motor when this one is silent for command_life_s, and at once when it
is gone. What the board does when that process is killed is not known. To be checked on the car before anything else:
that, and the signs (positive steering is left, positive throttle and encoder are ahead, the gyroscope counts
counter-clockwise).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from typing_extensions import Self

from drivers.errors import SilentPortError
from drivers.messages import FloatArray, Imu, LaserScan, Odometry
from drivers.qcar_link import GuardedBoard
from drivers.vehicle import (
    STANDSTILL,
    ArmingRefusedError,
    DriveCommand,
    VehicleLinkError,
    VehicleMessage,
    VehicleState,
)

# Quanser: 720 counts in quadrature a turn of the motor, gears 13/70 and 19/37, wheels of 33 mm radius.
METRES_PER_COUNT = (13.0 * 19.0) / (70.0 * 37.0) * 2.0 * math.pi * 0.033 / (720.0 * 4.0)
_EMPTY_V = 10.5  # three lithium cells
_GYRO_ZERO_S = 1.0  # the gyroscope's zero is averaged over about so long at standstill


class QcarBoard(Protocol):
    """The part of pal.products.qcar.QCar that is used; arrays have one or three elements."""

    motorEncoder: Any  # noqa: N815 - Quanser's name
    gyroscope: Any
    accelerometer: Any
    batteryVoltage: Any  # noqa: N815 - likewise

    def read(self) -> None:
        """Bring the attributes up to date."""
        ...

    def write(self, throttle: float, steering: float) -> None:
        """Set the duty cycle, -0.3 to 0.3, and the angle of the front wheels in rad."""
        ...

    def terminate(self) -> None:
        """Stop the motor, release the board."""
        ...


@dataclass(frozen=True, slots=True)
class QcarSettings:
    """kp, ki: duty cycle per m/s and per m, as Quanser's examples begin with; to be tuned on the car.

    python: the interpreter that Quanser's API is installed for, which may be an older one than ours.
    """

    wheelbase_m: float = 0.256
    steering_limit_rad: float = math.radians(30.0)
    throttle_limit: float = 0.3
    speed_limit_mps: float = 0.5
    kp: float = 0.1
    ki: float = 1.0
    command_life_s: float = 0.5
    python: str = sys.executable


class SpeedControl:
    """Duty cycle from speed: proportional and integral, without wind-up at the limit."""

    def __init__(self, settings: QcarSettings) -> None:
        self._settings = settings
        self._integral = 0.0

    def throttle(self, wanted_mps: float, measured_mps: float, dt_s: float) -> float:
        """Return the duty cycle for the next dt_s; 0 at standstill, so that a car that stands draws nothing."""
        settings = self._settings
        if wanted_mps == 0.0:
            self._integral = 0.0
            return 0.0
        error = wanted_mps - measured_mps
        integral = self._integral + settings.ki * error * dt_s
        throttle = settings.kp * error + integral
        if abs(throttle) <= settings.throttle_limit or error * throttle < 0:
            self._integral = integral
        limit = settings.throttle_limit
        return min(max(throttle, 0.0 if wanted_mps > 0 else -limit), limit if wanted_mps > 0 else 0.0)


class QcarVehicle:
    """See drivers.vehicle.Vehicle; poll() is also the control loop: call it at 50 Hz. clock: ns, monotonic.

    board: makes the board, for tests in this process; without it the board's process keeps the deadline.
    """

    name = "qcar"

    def __init__(
        self,
        clock: Callable[[], int],
        *,
        board: Callable[[], QcarBoard] | None = None,
        settings: QcarSettings | None = None,
    ) -> None:
        self.settings = settings or QcarSettings()
        self._clock = clock
        self.setpoint_timeout_s = self.settings.command_life_s if board is None else None
        self._open_board = board or self._guarded_board
        self._board: QcarBoard | None = None
        self._armed = False
        self._emergency = False
        self._command, self._commanded_ns = STANDSTILL, 0
        self._control = SpeedControl(self.settings)
        self._last: tuple[int, int] | None = None  # time in ns, encoder count
        self._pose = (0.0, 0.0, 0.0)
        self._gyro_zero_radps = 0.0
        self._state: VehicleState | None = None

    def __enter__(self) -> Self:
        """Open the board; SilentPortError where it does not answer."""
        board = self._open_board()
        try:
            board.read()
            if _number(board.batteryVoltage) <= 0.0:
                raise SilentPortError(
                    "qcar: the board answers nothing (battery 0 V): switch it on, end other programs on it"
                )
        except BaseException:
            board.terminate()
            raise
        self._board, self._last = board, None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        board, self._board, self._armed = self._board, None, False
        if board is not None:
            try:
                board.write(0.0, 0.0)
            finally:
                board.terminate()

    def arm(self) -> None:
        """Take commands from now on; ArmingRefusedError with an empty battery."""
        volts = _number(self._opened.batteryVoltage)
        if volts < _EMPTY_V:
            raise ArmingRefusedError(f"qcar: the battery has {volts:.1f} V, empty is {_EMPTY_V:g} V: charge it")
        self._armed, self._emergency, self._command = True, False, STANDSTILL

    def disarm(self) -> None:
        """Take none any more."""
        self._armed = False
        self._halt()

    def drive(self, command: DriveCommand) -> None:
        """Drive so from the next poll() on, for half a second; standstill is written at once."""
        if not self._armed:
            return
        self._command, self._commanded_ns = command, self._clock()
        if command.speed_mps == 0.0:
            self._opened.write(0.0, self._steering_rad(command))

    def stop(self) -> None:
        """Stand at once, until arm()."""
        self._armed = False
        self._halt()

    def emergency_stop(self) -> None:
        """Stand at once, until arm()."""
        self._emergency, self._armed = True, False
        self._halt()

    def poll(self) -> Sequence[VehicleMessage]:
        """Read the board, control the speed, return odometry, IMU and, where it has changed, the state."""
        board, now_ns = self._opened, self._clock()
        board.read()
        count = int(_number(board.motorEncoder))
        gyro, felt = _vector(board.gyroscope), _vector(board.accelerometer)
        last, self._last = self._last, (now_ns, count)
        messages: list[VehicleMessage] = [Imu(now_ns, gyro, felt)]
        if last is not None and now_ns > last[0]:
            dt_s = (now_ns - last[0]) * 1e-9
            speed_mps = (count - last[1]) * METRES_PER_COUNT / dt_s
            messages.append(self._roll(now_ns, speed_mps, float(gyro[2]), dt_s))
            self._steer_and_drive(now_ns, speed_mps, dt_s)
        ready = self._armed
        reason = "" if ready else "emergency stop: arm again" if self._emergency else "not armed"
        state = VehicleState(now_ns, self._armed, "drive" if ready else "hold", ready, reason)
        if self._state is None or (self._state.ready, self._state.reason) != (ready, reason):
            self._state = state
            messages.append(state)
        return messages

    def tell_pose(self, stamp_ns: int, T_map_base: FloatArray, twist: FloatArray, *, jumped: bool = False) -> None:
        """The board has no use for it."""

    def tell_scan(self, scan: LaserScan, T_base_laser: FloatArray) -> None:
        """Nor for this."""

    def _guarded_board(self) -> QcarBoard:
        settings = self.settings
        return GuardedBoard(settings.command_life_s, settings.throttle_limit, python=settings.python)

    @property
    def _opened(self) -> QcarBoard:
        if self._board is None:
            raise VehicleLinkError("qcar: not connected: use it in a with block")
        return self._board

    def _halt(self) -> None:
        self._command = STANDSTILL
        self._opened.write(0.0, 0.0)

    def _steering_rad(self, command: DriveCommand) -> float:
        limit = self.settings.steering_limit_rad
        return min(max(math.atan(self.settings.wheelbase_m * command.curvature_1pm), -limit), limit)

    def _steer_and_drive(self, now_ns: int, speed_mps: float, dt_s: float) -> None:
        fresh = now_ns - self._commanded_ns <= self.settings.command_life_s * 1e9
        if not (self._armed and fresh):
            self._command = DriveCommand(0.0, self._command.curvature_1pm)
        limit = self.settings.speed_limit_mps
        wanted_mps = min(max(self._command.speed_mps, -limit), limit)
        throttle = self._control.throttle(wanted_mps, speed_mps, dt_s)
        self._opened.write(throttle, self._steering_rad(self._command))

    def _roll(self, now_ns: int, speed_mps: float, gyro_radps: float, dt_s: float) -> Odometry:
        """The way by the encoder, laid along the heading by the gyroscope, whose zero is learned at standstill."""
        if speed_mps == 0.0 and self._command.speed_mps == 0.0:
            self._gyro_zero_radps += (gyro_radps - self._gyro_zero_radps) * min(1.0, dt_s / _GYRO_ZERO_S)
            yaw_rate = 0.0
        else:
            yaw_rate = gyro_radps - self._gyro_zero_radps
        x_m, y_m, yaw_rad = self._pose
        middle = yaw_rad + yaw_rate * dt_s / 2.0
        way_m = speed_mps * dt_s
        yaw = math.remainder(yaw_rad + yaw_rate * dt_s, 2.0 * math.pi)
        self._pose = (x_m + way_m * math.cos(middle), y_m + way_m * math.sin(middle), yaw)
        return Odometry(now_ns, np.array(self._pose), np.array([speed_mps, 0.0, yaw_rate]))


def _number(value: object) -> float:
    """Return a number that the API gives as such or as an array of one."""
    return float(np.asarray(value, dtype=np.float64).reshape(-1)[0])


def _vector(value: object) -> FloatArray:
    first: FloatArray = np.array(value, dtype=np.float64).reshape(-1)[:3]
    return first
