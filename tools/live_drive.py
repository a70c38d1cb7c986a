"""A car that drives itself to goals on a saved map while the session maps and records: a part of a live session.

Three threads have to do with it: the mapping thread hands scans to the autopilot, the reading thread tells that scans
come at all, and a thread of its own (tools/drive_thread.py) commands the car and waits for neither.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.messages import Imu, LaserScan, Odometry, Recordable, VelocityCommand
from drivers.vehicle import NullVehicle, Vehicle, VehicleMessage, VehicleState
from mapping.grid import OccupancyGrid
from mapping.slam import MappedScan
from planning.costmap import UnknownSpace
from planning.safety import SafeCommand
from tools.autopilot import Autopilot, AutopilotSettings, AutopilotState
from tools.bell import Bell
from tools.commanded_drive import CommandedDrive
from tools.config import Config
from tools.drive_log import DriveLog, Outcome
from tools.drive_thread import DriveThread
from tools.localisation import PlacesOnMap
from tools.path_search import PathSearch
from tools.session_parts import LiveSession

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)

_STATUS_S, _SAME_STATUS_S = 1.0, 10.0
_NOWHERE = (AutopilotState.locating, AutopilotState.lost)


@dataclass(frozen=True, slots=True, eq=False)
class DriveWanted:
    """Goals (3,) in the map's frame, one after the other; start (3,): where about the car stands, None: not known."""

    map_file: Path
    grid: OccupancyGrid
    goals: Sequence[FloatArray]
    start: FloatArray | None = None


def autopilot_settings(config: Config) -> AutopilotSettings:
    """Return how the configuration has the car driven."""
    drive, car, motion = config.drive, config.vehicle, config.vehicle.motion()
    speed = config.planning.speed.limits()
    top_mps = min(speed.top_mps, drive.speed_mps)
    return AutopilotSettings(
        margins_m=drive.margins_m,
        check_m=drive.check_m,
        pause_s=drive.pause_s,
        obstacle_range_m=drive.obstacle_range_m,
        unknown=UnknownSpace(config.planning.unknown),
        speed=replace(speed, top_mps=top_mps, creep_mps=min(speed.creep_mps, top_mps)),
        motion=motion,
        follower=drive.follower(car.curvature_limit_1pm),
        look_ahead=drive.look_ahead(),
        safety=drive.safety(car),
    )


class LiveDrive:
    """Drives an open vehicle to the goals; see tools.session_parts.SessionPart.

    search: looks for paths, beside. It ends the session when the last goal is reached, when there is no way, or when
    the car has not known where it is for config.drive.patience_s. `conclusion` tells how it ended and why.
    """

    tells = True

    def __init__(self, wanted: DriveWanted, vehicle: Vehicle, config: Config, search: PathSearch, bell: Bell) -> None:
        self.conclusion: tuple[Outcome, str] = (Outcome.interrupted, "ended before it began")
        self._wanted, self._vehicle, self._config = wanted, vehicle, config
        self._search, self._bell = search, bell
        self._places = PlacesOnMap(wanted.map_file)
        self._car: _PilotedCar | None = None
        self._thread: DriveThread | None = None

    def begin(self, session: LiveSession) -> None:
        """Begin to look for the place, then for a path; the car is armed once the place is known."""
        wanted, config = self._wanted, self._config
        pilot = Autopilot(
            wanted.grid,
            config.planning.vehicle(),
            wanted.goals,
            self._search,
            session.mount.pose[:2],
            autopilot_settings(config),
            wanted.start,
        )
        self._car = car = _PilotedCar(pilot, self._vehicle, wanted.goals, session, config.drive.patience_s)
        self._thread = DriveThread(car, self._vehicle, session.clock, self._bell, session.stop, car.look)
        self._thread.start()

    def note(self, message: Recordable) -> None:
        """Let the safety stage and the vehicle know of a scan."""
        if isinstance(message, LaserScan) and self._car is not None:
            self._car.note_scan(message)

    def add(self, mapped: MappedScan) -> None:
        """Let the autopilot find the place."""
        if self._car is None:
            return
        pilot = self._car.pilot
        pilot.add_scan(mapped)
        if mapped.match.accepted:
            place = pilot.place
            self._places.add(mapped.stamp_ns, place, self._car.status(mapped.stamp_ns) if place is None else place.reason)

    def end(self) -> None:
        """Make the car stand; the thread does so by itself, and at once, where a signal or the drive's end comes."""
        if self._thread is None or self._car is None:
            return
        self._thread.end()
        self.conclusion = self._car.conclusion(self._thread.failure)
        outcome, reason = self.conclusion
        (log.info if outcome is Outcome.arrived else log.warning)("drive: %s: %s", outcome.value, reason)

    def save(self, folder: Path) -> dict[str, Any]:
        """Write where the car was on the map; return sections `drive` and `localisation`."""
        if self._car is None or self._thread is None:
            return {}
        outcome, reason = self.conclusion
        pace = self._thread.pace
        report = {
            "vehicle": self._vehicle.name,
            "setpoint_timeout_s": self._vehicle.setpoint_timeout_s,
            "outcome": outcome.value,
            "reason": reason,
            **self._car.report(),
            "steps": pace.steps,
            "longest_step_s": round(pace.longest_s, 3),
            "late_steps": pace.late,
        }
        return {"drive": report, "localisation": self._places.save(folder)}


class _PilotedCar:
    """Autopilot and vehicle together, as the thread steps them; what comes of it is recorded and logged."""

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
        self._vehicle, self._put, self._patience_s = vehicle, session.put, patience_s
        self._begun_s = session.clock() * 1e-9
        self._log = DriveLog(pilot, goals, self._begun_s)
        self._known_s = self._begun_s
        self._safe: SafeCommand | None = None
        self._paths = 0
        self._status = StatusLine()
        self._fault = ""

    @property
    def fault(self) -> str:
        """Why the vehicle is not driven any more."""
        return self._commanded.fault

    @property
    def armed(self) -> bool:
        """Whether the car may be moving."""
        return self._commanded.armed

    def step(self, now_ns: int) -> object:
        """Command the car."""
        safe = self._commanded.step(now_ns)
        if safe is not self._safe:
            self._safe = safe
            self._record(now_ns, safe)
        return safe

    def emergency_stop(self, reason: str) -> None:
        """Let nothing but standstill through."""
        self.pilot.safety.emergency_stop(reason)

    def note_scan(self, scan: LaserScan) -> None:
        """Take a scan as it came, in the thread that reads."""
        self.pilot.note_scan(scan.stamp_ns * 1e-9)
        self._commanded.note_scan(scan)

    def status(self, now_ns: int) -> str:
        """Return how things stand, in a line."""
        words = self.pilot.status(now_ns * 1e-9)
        if self.fault and self.fault not in words:
            words = f"standing: {self.fault}"
        if isinstance(self._vehicle, NullVehicle) and self._safe is not None and not self._safe.stopped:
            command = self._safe.command
            words += f" (no vehicle: would command {command.speed_mps:.2f} m/s, curvature {command.curvature_1pm:.2f}/m)"
        return words

    def look(self, now_ns: int) -> bool:
        """Tell how things stand; return whether the drive is over."""
        now_s, state = now_ns * 1e-9, self.pilot.state
        if state not in _NOWHERE:
            self._known_s = now_s
        if self.fault and not self._fault:
            self._fault = self.fault
            log.warning("THE CAR IS NOT DRIVEN ANY MORE: %s; mapping and recording go on, Ctrl-C ends them", self.fault)
        self._status.tell(now_s, lambda: self.status(now_ns))
        if self.fault or self.pilot.safety.emergency:
            return False
        return state in (AutopilotState.arrived, AutopilotState.no_way) or self._gave_up(now_s)

    def conclusion(self, failure: BaseException | None) -> tuple[Outcome, str]:
        """Return how the drive ended, and why."""
        pilot = self.pilot
        now_s = self._known_s
        if failure is not None:
            return Outcome.failed, f"{type(failure).__name__}: {failure}"
        if self.fault:
            return Outcome.vehicle_fault, self.fault
        if pilot.state is AutopilotState.arrived:
            return Outcome.arrived, "all goals reached"
        if pilot.safety.emergency:
            return Outcome.emergency, pilot.safety.emergency
        words = pilot.status(now_s)
        if pilot.state is AutopilotState.no_way:
            return Outcome.no_way, words
        if self._gave_up_s is not None:
            return Outcome.lost, words
        return Outcome.interrupted, f"before goal {pilot.goal_number + 1} was reached"

    def report(self) -> dict[str, Any]:
        """Return what happened."""
        paths = [
            {"at_s": self._log.since_s(drive.begun_s), "length_m": round(drive.path.length_m, 3), "reason": drive.reason}
            for drive in self.pilot.drives
        ]
        return {**self._log.report(self.pilot.notes), "paths": paths}

    _gave_up_s: float | None = None

    def _gave_up(self, now_s: float) -> bool:
        if now_s - self._known_s > self._patience_s:
            self._gave_up_s = now_s
        return self._gave_up_s is not None

    def _record(self, now_ns: int, safe: SafeCommand) -> None:
        command = safe.command
        self._put(VelocityCommand(now_ns, command.speed_mps, command.yaw_rate_radps))
        for drive in self.pilot.drives[self._paths :]:
            self._paths += 1
            self._put(drive.path.to_message(now_ns))
            cusps = len(drive.path.cusps)
            log.info("path of %.2f m, %d gear changes: %s", drive.path.length_m, cusps, drive.reason)
        self._log.note(now_ns * 1e-9, safe, at_end=self.pilot.state is AutopilotState.arrived)

    def _hear(self, message: VehicleMessage) -> None:
        if isinstance(message, Odometry | Imu):
            self._put(message)
        elif isinstance(message, VehicleState):
            self._status.vehicle(message)


class StatusLine:
    """Says once a second how things stand, and what has not changed every ten."""

    def __init__(self, say: Callable[[str], None] = log.info) -> None:
        self._say = say
        self._next_s = -math.inf
        self._told = ("", -math.inf)
        self._state: VehicleState | None = None

    def tell(self, now_s: float, words: Callable[[], str]) -> None:
        """Say it, if it is time."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _STATUS_S
        line, (last, last_s) = words(), self._told
        if line != last or now_s - last_s >= _SAME_STATUS_S:
            self._told = (line, now_s)
            self._say(line)

    def vehicle(self, state: VehicleState) -> None:
        """Say what has changed about the vehicle."""
        last, self._state = self._state, state
        if last is None or (last.armed, last.mode) != (state.armed, state.mode):
            self._say(f"vehicle: {'armed' if state.armed else 'disarmed'}, mode {state.mode}")


def vehicle_fault(reason: str) -> DriverError:
    """Return the error of a run whose vehicle was lost or would not drive, for the exit code."""
    return DriverError(f"the car did not drive to its goals: {reason}; what came until then is saved")
