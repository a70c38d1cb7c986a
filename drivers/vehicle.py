"""What a car is to the programs that drive it: one protocol, whatever the link, and a car that is none.

Frames are REP-103: base_link is the middle of the rear axle, x ahead, y left, yaw counter-clockwise. A link converts at
its own border (drivers/mavlink_frames.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

from typing_extensions import Self

from drivers.errors import DriverError
from drivers.messages import FloatArray, Imu, LaserScan, Odometry


class VehicleLinkError(DriverError):
    """The car, or the way to it, does not do what was asked; also the base of the errors that follow."""


class ArmingRefusedError(VehicleLinkError):
    """The car refuses to arm; the text has the reason where it tells one."""


class WrongModeError(VehicleLinkError):
    """The car is not in the mode in which it takes our commands, or will not go into it."""


class LostVehicleError(VehicleLinkError):
    """The car was there and is heard no more."""


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """How to drive from now on: speed of the rear axle, negative backwards, and curvature of its way, positive left.

    Curvature rather than yaw rate, so that the steering is told also while the car stands. Raises ValueError for
    values that are not finite.
    """

    speed_mps: float
    curvature_1pm: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed_mps) and math.isfinite(self.curvature_1pm)):
            raise ValueError(f"speed {self.speed_mps} m/s, curvature {self.curvature_1pm} 1/m: expected finite values")

    @property
    def yaw_rate_radps(self) -> float:
        """Turning speed, counter-clockwise."""
        return self.speed_mps * self.curvature_1pm


STANDSTILL = DriveCommand(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What the car says about itself. ready: it would follow a drive command now; reason: why not, else empty."""

    stamp_ns: int
    armed: bool
    mode: str
    ready: bool
    reason: str = ""


VehicleMessage = VehicleState | Odometry | Imu


class Vehicle(Protocol):
    """A car under our command, as a context manager: entering connects, leaving stops it and closes the link.

    setpoint_timeout_s: after so long without a command the car stops by itself, as read from it; None: it does not, or
    nobody knows. Where commands stop coming, also because our process is gone, only this stops the car.
    """

    name: str

    @property
    def setpoint_timeout_s(self) -> float | None:
        """See above."""
        ...

    def __enter__(self) -> Self:
        """Connect; raises DriverError."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def arm(self) -> None:
        """Make the car ready to drive; waits for its answer. ArmingRefusedError, WrongModeError, LostVehicleError."""
        ...

    def disarm(self) -> None:
        """Take the drive's power away; waits for the answer."""
        ...

    def drive(self, command: DriveCommand) -> None:
        """Drive so from now on; returns within 5 ms. After an emergency stop nothing but standstill leaves."""
        ...

    def stop(self) -> None:
        """Command standstill several times over, then hold; returns within 5 ms."""
        ...

    def emergency_stop(self) -> None:
        """Stop with all that the link has and refuse drive commands until the next arm(); returns within 5 ms."""
        ...

    def poll(self) -> Sequence[VehicleMessage]:
        """Do what is due (heartbeats, repetition), return what has come since the last call; call it at 20 Hz or more.

        Raises LostVehicleError once the car has been silent for too long.
        """
        ...

    def tell_pose(self, stamp_ns: int, T_map_base: FloatArray, twist: FloatArray, *, jumped: bool = False) -> None:
        """Tell the car where it is: pose (3,) in the map, twist (vx, vy, wz) in base_link.

        jumped: the map was corrected and this pose does not follow from the last by driving.
        """
        ...

    def tell_scan(self, scan: LaserScan, T_base_laser: FloatArray) -> None:
        """Tell the car what stands around it; T_base_laser (3,): the laser on the car."""
        ...


class NullVehicle:
    """No car: takes every command, moves nothing, and says so; clock: returns ns for the stamps."""

    name = "none"
    setpoint_timeout_s: float | None = None

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._armed = False
        self._stopped = False
        self._told = True
        self.command = STANDSTILL

    def __enter__(self) -> Self:
        self._told = False
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.disarm()

    def arm(self) -> None:
        """Arm, and release an emergency stop."""
        self._armed, self._stopped, self._told = True, False, False

    def disarm(self) -> None:
        """Disarm."""
        self._armed, self._told, self.command = False, False, STANDSTILL

    def drive(self, command: DriveCommand) -> None:
        """Keep the command to be looked at; standstill where the car is not armed or stopped for an emergency."""
        self.command = command if self._armed and not self._stopped else STANDSTILL

    def stop(self) -> None:
        """Stand."""
        self.command = STANDSTILL

    def emergency_stop(self) -> None:
        """Stand until armed again."""
        self._stopped, self._told, self.command = True, False, STANDSTILL

    def poll(self) -> Sequence[VehicleMessage]:
        """Return the state where it has changed."""
        if self._told:
            return ()
        self._told = True
        ready = self._armed and not self._stopped
        reason = "" if ready else "emergency stop: arm again" if self._stopped else "not armed"
        return (VehicleState(self._clock(), self._armed, "none", ready, reason),)

    def tell_pose(self, stamp_ns: int, T_map_base: FloatArray, twist: FloatArray, *, jumped: bool = False) -> None:
        """Nobody listens."""

    def tell_scan(self, scan: LaserScan, T_base_laser: FloatArray) -> None:
        """Nobody listens."""
