"""A car that drives itself to goals while the session maps and records: a part of a live session.

The goals are on a saved map, or, without one, on the map that the session is making, whose frame is the car's start.

Three threads have to do with it: the mapping thread hands scans to the autopilot, the reading thread tells that scans
come at all, and a thread of its own (tools/drive_thread.py) commands the car and waits for neither.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Recordable
from drivers.vehicle import Vehicle
from mapping.grid import OccupancyGrid
from mapping.slam import MappedScan
from planning.costmap import UnknownSpace
from tools.autopilot import Autopilot, AutopilotSettings
from tools.bell import Bell
from tools.config import Config
from tools.drive_log import Outcome
from tools.drive_thread import DriveThread
from tools.growing_ground import GrowingGround, exploring
from tools.localisation import PlacesOnMap
from tools.path_search import PathSearch
from tools.piloted_car import PilotedCar
from tools.session_parts import LiveSession

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class DriveWanted:
    """Goals (3,) in the map's frame, one after the other; start (3,): where about the car stands, None: not known.

    saved None: on the map that is being made, and start means nothing.
    """

    goals: Sequence[FloatArray]
    saved: SavedMap | None = None
    start: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A map and the file that it was read from."""

    file: Path
    grid: OccupancyGrid


def autopilot_settings(config: Config) -> AutopilotSettings:
    """Return how the configuration has the car driven."""
    drive, car = config.drive, config.vehicle
    speed = config.planning.speed.limits()
    top_mps = min(speed.top_mps, drive.speed_mps)
    return AutopilotSettings(
        margins_m=drive.margins_m,
        check_m=drive.check_m,
        pause_s=drive.pause_s,
        back_m=drive.back_m,
        back_offs=drive.back_offs,
        obstacle_range_m=drive.obstacle_range_m,
        unknown=UnknownSpace(config.planning.unknown),
        speed=replace(speed, top_mps=top_mps, creep_mps=min(speed.creep_mps, top_mps)),
        motion=car.motion(),
        follower=drive.follower(car.curvature_limit_1pm),
        look_ahead=drive.look_ahead(),
        safety=drive.safety(car),
    )


class LiveDrive:
    """Drives an open vehicle to the goals; see tools.session_parts.SessionPart. search: looks for paths, beside.

    It ends the session when the last goal is reached, when there is no way, or when the car has not known where it is
    for drive.patience_s of the configuration. conclusion: how it ended, and why.
    """

    tells = True
    hurries = True

    def __init__(self, wanted: DriveWanted, vehicle: Vehicle, config: Config, search: PathSearch, bell: Bell) -> None:
        self.conclusion: tuple[Outcome, str] = (Outcome.interrupted, "ended before it began")
        self._wanted, self._vehicle, self._config = wanted, vehicle, config
        self._search, self._bell = search, bell
        self.needs_map = wanted.saved is None
        self._places = None if wanted.saved is None else PlacesOnMap(wanted.saved.file)
        self._car: PilotedCar | None = None
        self._thread: DriveThread | None = None

    def begin(self, session: LiveSession) -> None:
        """Begin to look for the place, then for a path; the car is armed once the place is known."""
        wanted, config = self._wanted, self._config
        settings, body = autopilot_settings(config), config.planning.vehicle()
        ground: OccupancyGrid | GrowingGround
        if wanted.saved is not None:
            ground = wanted.saved.grid
        else:
            assert session.grid_now is not None
            settings = exploring(settings)
            ground = GrowingGround(session.grid_now, body, settings, wanted.goals)
        laser = session.mount.pose[:2]
        pilot = Autopilot(ground, body, wanted.goals, self._search, laser, settings, wanted.start)
        self._car = car = PilotedCar(pilot, self._vehicle, wanted.goals, session, config.drive.patience_s)
        self._thread = DriveThread(car, self._vehicle, session.clock, self._bell, session.stop, car.look)
        self._thread.start()

    def status(self) -> str:
        """Return how the drive stands, in a line; any thread may ask."""
        return self.conclusion[1] if self._car is None else self._car.status()

    def note(self, message: Recordable) -> None:
        """Let the safety stage and the vehicle know of a scan."""
        if isinstance(message, LaserScan) and self._car is not None:
            self._car.note_scan(message)

    def add(self, mapped: MappedScan) -> None:
        """Let the autopilot find the place."""
        if self._car is None:
            return
        self._car.pilot.add_scan(mapped)
        if mapped.match.accepted and self._places is not None:
            place = self._car.pilot.place
            self._places.add(mapped.stamp_ns, place, self._car.status() if place is None else place.reason)

    def end(self) -> None:
        """Make the car stand; its thread does so at once by itself where a signal, or the end of the drive, comes."""
        if self._thread is None or self._car is None:
            return
        self._thread.end()
        self.conclusion = outcome, reason = self._car.conclusion(self._thread.failure)
        log.log(logging.INFO if outcome is Outcome.arrived else logging.WARNING, "drive: %s: %s", outcome.value, reason)

    def save(self, folder: Path) -> dict[str, Any]:
        """Write where the car was on the map; return sections `drive` and `localisation`."""
        if self._thread is None or self._car is None:
            return {}
        outcome, reason = self.conclusion
        drive = {
            "vehicle": self._vehicle.name,
            "setpoint_timeout_s": self._vehicle.setpoint_timeout_s,
            "outcome": outcome.value,
            "reason": reason,
            **self._car.report(),
            "thread": self._thread.pace.summary(),
        }
        return {"drive": drive, **({} if self._places is None else {"localisation": self._places.save(folder)})}
