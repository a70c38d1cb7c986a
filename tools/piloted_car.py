"""Autopilot and vehicle together, as the drive's thread steps them: what comes of it is recorded, told and kept."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Imu, LaserScan, Odometry, VelocityCommand
from drivers.vehicle import NullVehicle, Vehicle, VehicleMessage, VehicleState
from planning.safety import SafeCommand
from tools.autopilot import Autopilot, AutopilotState
from tools.commanded_drive import CommandedDrive
from tools.drive_log import DriveLog, Outcome
from tools.drive_status import ENDS, NOWHERE
from tools.session_parts import LiveSession
from tools.status_line import StatusLine

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)


class PilotedCar:
    """See tools.drive_thread.Driven. patience_s: how long the car may not know where it is before it gives up.

    Commands go into the recording as /cmd_vel, paths as /plan, the vehicle's wheels and IMU as /odom and /imu.
    """

    def __init__(
        self,
        pilot: Autopilot,
        vehicle: Vehicle,
        goals: Sequence[FloatArray],
        session: LiveSession,
        patience_s: float,
    ) -> None:
        self.pilot = pilot
        self._commanded = CommandedDrive(pilot, vehicle, mount=session.mount, on_message=self._hear)
        self._has_vehicle = not isinstance(vehicle, NullVehicle)
        self._put, self._clock, self._patience_s = session.put, session.clock, patience_s
        self._known_s = session.clock() * 1e-9
        self._log = DriveLog(pilot, goals, self._known_s)
        self._status = StatusLine()
        self._safe: SafeCommand | None = None
        self._paths = 0
        self._emergency = ""
        self._fault_told = self._gave_up = False

    @property
    def fault(self) -> str:
        """Why the vehicle is not driven any more; empty where it is, and where it stands because we stopped it."""
        return "" if self._emergency else self._commanded.fault

    @property
    def left(self) -> bool:
        """Whether somebody else may have the vehicle; not where it was we who disarmed it."""
        return self._commanded.left and not self._emergency

    @property
    def armed(self) -> bool:
        """Whether the car may be moving by our commands."""
        return self._commanded.armed

    def step(self, now_ns: int) -> object:
        """Command the car."""
        safe = self._commanded.step(now_ns)
        if safe is not self._safe:
            self._safe = safe
            self._keep(now_ns, safe)
        return safe

    def emergency_stop(self, reason: str) -> None:
        """Let nothing but standstill through; a fault of before stays what it was."""
        self._emergency = self._emergency or ("" if self._commanded.fault else reason)
        self.pilot.safety.emergency_stop(reason)

    def note_scan(self, scan: LaserScan) -> None:
        """Take a scan as it came, in the thread that reads."""
        self.pilot.note_scan(scan.stamp_ns * 1e-9)
        self._commanded.note_scan(scan)

    def status(self) -> str:
        """Return how things stand, in a line."""
        words, safe = self.pilot.status(self._clock() * 1e-9), self._safe
        if self.fault and self.fault not in words:
            words = f"standing: {self.fault}"
        if not self._has_vehicle and safe is not None and not safe.stopped:
            told = f"{safe.command.speed_mps:.2f} m/s, curvature {safe.command.curvature_1pm:.2f}/m"
            words += f" (no vehicle: it would be told {told})"
        return words

    def look(self, now_ns: int) -> bool:
        """Tell how things stand; return whether the drive is over."""
        now_s, state = now_ns * 1e-9, self.pilot.state
        if state not in NOWHERE and self.pilot.place is not None:
            self._known_s = max(self._known_s, self.pilot.place.stamp_ns * 1e-9)
        if self.fault and not self._fault_told:
            self._fault_told = True
            log.warning("THE CAR IS NOT DRIVEN ANY MORE: %s; mapping and recording go on, Ctrl-C ends them", self.fault)
        self._status.tell(now_s, self.status)
        if self.fault or self.pilot.safety.emergency:
            return False
        self._gave_up = now_s - self._known_s > self._patience_s
        return self._gave_up or state in ENDS

    def conclusion(self, failure: BaseException | None) -> tuple[Outcome, str]:
        """Return how the drive ended, and why; failure: what the thread died of."""
        pilot = self.pilot
        if failure is not None:
            return Outcome.failed, f"{type(failure).__name__}: {failure}"
        if pilot.state is AutopilotState.arrived:
            return Outcome.arrived, "all goals reached"
        if self.fault:
            return Outcome.vehicle_fault, self.fault
        if self._emergency:
            return Outcome.emergency, self._emergency
        if pilot.state is AutopilotState.no_way:
            return Outcome.no_way, self.status()
        if self._gave_up:
            return Outcome.lost, f"its place was not known for {self._patience_s:g} s: {self.status()}"
        return Outcome.interrupted, f"before goal {pilot.goal_number + 1} was reached"

    def report(self) -> dict[str, Any]:
        """Return what happened."""
        paths = [
            {
                "at_s": self._log.since_s(drive.begun_s),
                "length_m": round(drive.path.length_m, 3),
                "reason": drive.reason,
            }
            for drive in self.pilot.drives
        ]
        return {**self._log.report(self.pilot.notes), "paths": paths}

    def _keep(self, now_ns: int, safe: SafeCommand) -> None:
        """Record a command, and the path that it follows where that is new."""
        command = safe.command
        self._put(VelocityCommand(now_ns, command.speed_mps, command.yaw_rate_radps))
        for drive in self.pilot.drives[self._paths :]:
            self._paths += 1
            self._put(drive.path.to_message(now_ns))
            shifts = len(drive.path.cusps)
            log.info("path of %.2f m, %d gear changes: %s", drive.path.length_m, shifts, drive.reason)
        self._log.note(now_ns * 1e-9, safe, at_end=self.pilot.state is AutopilotState.arrived)

    def _hear(self, message: VehicleMessage) -> None:
        if isinstance(message, VehicleState):
            self._status.vehicle(message)
        elif isinstance(message, Odometry | Imu):
            self._put(message)
