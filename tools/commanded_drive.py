"""An autopilot's commands to a vehicle, and what the vehicle says back: the same code in the simulator and on a car.

No clock and no thread: whoever has them calls step(). The car is armed once, when the autopilot knows where it is. What
the vehicle says against driving goes to the autopilot's safety stage, so that the autopilot knows that it stands.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.messages import LaserScan, Odometry
from drivers.vehicle import (
    STANDSTILL,
    ArmingRefusedError,
    Vehicle,
    VehicleMessage,
    VehicleState,
    WrongModeError,
)
from mapping.mount import Mount
from mapping.relocalisation import Located
from planning.safety import SafeCommand, SafetyStage
from tools.speed_watch import SpeedWatch
from tools.vehicle_telling import VehicleTelling

FloatArray = NDArray[np.float64]

_ARM_EVERY_NS = 2_000_000_000
_ARM_TRIES = 5  # a vehicle's filter takes some seconds to believe in the poses that it is told
_NOT_READY_NS = 3_000_000_000  # so long, and it is for good: somebody else has the car


class Pilot(Protocol):
    """What is needed of tools.autopilot.Autopilot."""

    @property
    def safety(self) -> SafetyStage:
        """The last stage before the vehicle."""
        ...

    @property
    def place(self) -> Located | None:
        """Where the car was last found to be, None where it is not known."""
        ...

    def tick(self, now_s: float) -> SafeCommand:
        """Return what to send to the vehicle now."""
        ...


class CommandedDrive:
    """Call step() at 20 Hz or more, from one thread; the pilot is asked every period_s, the vehicle at each call.

    mount: the laser on the car. on_message: is told all that comes from the vehicle. fault: why the vehicle is not
    driven any more, empty where it is; a fault is for good: the car stands until all is started anew. left: somebody
    else may have it, and nothing is said to it any more.
    """

    def __init__(
        self,
        pilot: Pilot,
        vehicle: Vehicle,
        period_s: float = 0.05,
        *,
        mount: Mount | None = None,
        on_message: Callable[[VehicleMessage], None] = lambda _: None,
    ) -> None:
        self.fault = ""
        self.left = False
        self.state: VehicleState | None = None
        self._pilot, self._vehicle = pilot, vehicle
        self._period_ns = round(period_s * 1e9)
        self._on_message = on_message
        self._safe = SafeCommand(STANDSTILL, "not started yet", stopped=True)
        self._next_ns: int | None = None
        self._armed = False
        self._arm_ns, self._arm_tries = 0, 0
        self._unready_ns: int | None = None
        self._cut = False
        self._telling = VehicleTelling(vehicle, mount or Mount())
        self._watch = SpeedWatch()

    @property
    def armed(self) -> bool:
        """Whether the vehicle was armed for this drive."""
        return self._armed

    def note_scan(self, scan: LaserScan) -> None:
        """Take a scan for the vehicle to be told at the next step; may come from another thread."""
        self._telling.note_scan(scan)

    def step(self, now_ns: int) -> SafeCommand:
        """Hear the vehicle, ask the pilot if it is time, send its command; return what was commanded last."""
        self._attempt(lambda: self._hear(now_ns))
        if self._next_ns is not None and now_ns < self._next_ns:
            return self._safe
        late = self._next_ns is None or now_ns - self._next_ns >= self._period_ns
        self._next_ns = now_ns + self._period_ns if late else (self._next_ns or 0) + self._period_ns
        self._attempt(lambda: self._telling.tell(self._pilot.place, now_ns))
        if not self._armed:
            self._arm(now_ns)
        self._safe = safe = self._pilot.tick(now_ns * 1e-9)
        self._attempt(lambda: self._send(safe))
        self._judge(now_ns, safe)
        return safe

    def _judge(self, now_ns: int, safe: SafeCommand) -> None:
        """End the drive where the car does not do what it is told, but where somebody else drives it."""
        amiss = self._watch.tell(now_ns * 1e-9, safe.command.speed_mps) if self._armed else ""
        ours = self._pilot.safety.emergency or (self.state is not None and self.state.ready)
        if amiss and ours:
            self._fail(amiss)

    def _attempt(self, exchange: Callable[[], None]) -> None:
        """Exchange something with the vehicle; what the link raises ends the drive, and the car is told to stand."""
        try:
            exchange()
        except DriverError as error:
            self._fail(str(error))

    def _fail(self, reason: str) -> None:
        if self.fault:
            return
        self.fault = reason
        self._pilot.safety.emergency_stop(reason)
        with suppress(DriverError):  # at once; the next command does it again where this did not leave
            self._vehicle.emergency_stop()
            self._cut = True

    def _leave(self, reason: str) -> None:
        """End the drive without another word to the vehicle: somebody else may have it."""
        self.fault, self.left = self.fault or reason, True
        self._pilot.safety.hold(reason)

    def _hear(self, now_ns: int) -> None:
        for message in self._vehicle.poll():
            if isinstance(message, VehicleState):
                self.state = message
            elif isinstance(message, Odometry):
                self._watch.report(now_ns * 1e-9, float(message.twist[0]))
            self._on_message(message)
        if not self._armed or self.fault:
            return
        if self.state is None or self.state.ready:
            self._unready_ns = None
            self._pilot.safety.hold("")
            return
        reason = f"the vehicle is not ready: {self.state.reason}"
        self._unready_ns = now_ns if self._unready_ns is None else self._unready_ns
        self._pilot.safety.hold(reason)
        if now_ns - self._unready_ns > _NOT_READY_NS:
            self._leave(reason)

    def _arm(self, now_ns: int) -> None:
        """Arm once the place is known; the car stands before, and between the tries."""
        if self.fault or self._pilot.safety.emergency or now_ns < self._arm_ns:
            return
        if self._pilot.place is None:
            self._pilot.safety.hold("the vehicle is armed once the place is known")
            return
        self._arm_tries += 1
        try:
            self._vehicle.arm()
        except (ArmingRefusedError, WrongModeError) as error:
            self._arm_ns = now_ns + _ARM_EVERY_NS
            self._pilot.safety.hold(str(error))
            if self._arm_tries >= _ARM_TRIES:
                self._leave(str(error))
        except DriverError as error:
            self._fail(str(error))
        else:
            self._armed, self.state = True, None
            self._pilot.safety.hold("")

    def _send(self, safe: SafeCommand) -> None:
        """Send the command, or all that the link has against driving on where the pilot's emergency stop is pressed."""
        if not self._pilot.safety.emergency:
            self._vehicle.drive(safe.command)
        elif not self._cut:
            self._vehicle.emergency_stop()
            self._cut = True
