"""What a live session is to do beside mapping: find the car on a map, tell a vehicle where it is, drive it to goals."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.vehicle import NullVehicle, Vehicle, VehicleLinkError
from tools.bell import Bell
from tools.clock import RunClock
from tools.config import Config
from tools.drive_goals import Pose, check_goals
from tools.drive_log import Outcome
from tools.drive_thread import EMERGENCIES, KEY
from tools.drive_warm_up import warm_up_drive
from tools.errors import ToolError, UsageError
from tools.live_drive import DriveWanted, LiveDrive, SavedMap
from tools.live_telling import LiveTelling
from tools.localisation import FoundOnMap
from tools.map_reading import read_saved
from tools.path_search import PathSearchBeside
from tools.session_parts import SessionPart
from tools.stop_key import on_enter
from tools.vehicle_link import NONE, vehicle_at

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class JourneyWanted:
    """What the command line asks for; vehicle None: not told. Raises UsageError for what makes no sense together."""

    map_file: Path | None = None
    goals: tuple[Pose, ...] = ()
    start: Pose | None = None
    vehicle: str | None = None
    has_lidar: bool = True
    resumes: bool = False

    def __post_init__(self) -> None:
        if self.goals and not self.has_lidar:
            raise UsageError("--goal: needs --lidar: a car that drives must see all around")
        if self.goals and self.resumes and self.map_file is None:
            raise UsageError("--goal: with --resume only with --map: where the car stands on that map is not known")
        if self.start is not None and not self.goals:
            raise UsageError("--start: only with --goal; without it the car is looked for on the whole map")
        if self.start is not None and self.map_file is None:
            raise UsageError("--start: only with --map; without it the car's start is where the map begins")

    @property
    def uses_vehicle(self) -> bool:
        """Whether a vehicle is heard."""
        return bool(self.goals) or self.vehicle not in {None, NONE}


@dataclass(frozen=True, slots=True)
class Journey:
    """The parts of the session that come of it."""

    parts: tuple[SessionPart, ...]
    drive: LiveDrive | None = None
    telling: LiveTelling | None = None

    def conclude(self) -> bool:
        """Return whether all was reached, once the session is saved.

        Raises VehicleLinkError where the vehicle was lost or would not drive, ToolError where the drive itself failed.
        """
        outcome, reason = (Outcome.arrived, "") if self.drive is None else self.drive.conclusion
        if self.telling is not None:
            if self.telling.failure is not None:
                outcome, reason = Outcome.failed, repr(self.telling.failure)
            elif self.telling.fault:
                outcome, reason = Outcome.vehicle_fault, self.telling.fault
        if outcome is Outcome.failed:
            raise ToolError(f"the drive failed ({reason}) and the car was stopped; all else is saved: please report it")
        if outcome is Outcome.vehicle_fault:
            raise VehicleLinkError(f"{reason} (all is saved)")
        return outcome is Outcome.arrived


def without_wheels(config: Config) -> Config:
    """Return the configuration of a run that records the vehicle's odometry and does not map with it.

    A scan would wait for it, and a car that drives cannot; and a replay has to do as the run did.
    """
    odometry = config.odometry.model_copy(update={"use_wheel_odometry": False})
    return config.model_copy(update={"odometry": odometry})


@contextmanager
def journey(wanted: JourneyWanted, config: Config, clock: RunClock) -> Iterator[Journey]:
    """Check it all, open the vehicle, and yield what goes along with the session; the car stands at the end.

    Main thread only: signals ring the bell of the drive's thread. Raises ToolError for goals that cannot be reached,
    DriverError where there is no vehicle.
    """
    with ExitStack() as opened:
        if not wanted.uses_vehicle:
            yield Journey(() if wanted.map_file is None else (FoundOnMap(wanted.map_file),))
            return
        vehicle = vehicle_at(wanted.vehicle or NONE, clock)
        drive_wanted = _checked(wanted, config)
        bell = opened.enter_context(Bell())
        search = None if drive_wanted is None else opened.enter_context(_search(config))
        if search is not None:
            warm_up_drive()  # while the planning process starts
        opened.enter_context(vehicle)
        _tell_vehicle(vehicle, driven=drive_wanted is not None)
        opened.enter_context(bell.rung_by_signals(EMERGENCIES))
        if drive_wanted is None or search is None:
            found = None if wanted.map_file is None else FoundOnMap(wanted.map_file)
            telling = LiveTelling(vehicle, bell, None if found is None else lambda: found.place)
            yield Journey((telling,) if found is None else (found, telling), telling=telling)
            return
        if opened.enter_context(on_enter(lambda: bell.ring(KEY))):
            log.info("emergency stop: Enter; Ctrl-C: the car stands, then all is saved")
        drive = LiveDrive(drive_wanted, vehicle, config, search, bell)
        yield Journey((drive,), drive=drive)


def _checked(wanted: JourneyWanted, config: Config) -> DriveWanted | None:
    if not wanted.goals:
        return None
    grid = None if wanted.map_file is None else read_saved(wanted.map_file)
    check_goals(grid, config, wanted.goals, wanted.start)
    goals = [np.array(goal) for goal in wanted.goals]
    if grid is None or wanted.map_file is None:
        return DriveWanted(goals)
    saved = SavedMap(wanted.map_file, grid)
    return DriveWanted(goals, saved, None if wanted.start is None else np.array(wanted.start))


def _search(config: Config) -> PathSearchBeside:
    return PathSearchBeside(time.monotonic, config.planning.plan_settings())


def _tell_vehicle(vehicle: Vehicle, *, driven: bool) -> None:
    """Say what has been connected, and what stops it if this process no longer does."""
    if isinstance(vehicle, NullVehicle):
        log.info("no vehicle: what it would be told is logged and recorded")
        return
    if isinstance(vehicle, MavlinkVehicle):
        for warning in vehicle.warnings:
            log.warning("%s: %s", vehicle.name, warning)
    timeout_s = vehicle.setpoint_timeout_s
    if not driven:
        log.info("%s: connected; it is told where it is, and not driven", vehicle.name)
    elif timeout_s is None:
        log.warning("%s: connected; NOTHING STOPS IT if this program is killed, as far as is known", vehicle.name)
    else:
        log.info("%s: connected; without commands it stops by itself after %g s", vehicle.name, timeout_s)
