"""A vehicle that is told where it is and what stands around it, and is not driven: a part of a live session."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DriverError
from drivers.messages import Imu, LaserScan, Odometry, Recordable
from drivers.vehicle import Vehicle, VehicleState
from mapping.relocalisation import Located
from mapping.slam import MappedScan
from tools.bell import Bell
from tools.drive_thread import DriveThread
from tools.session_parts import LiveSession
from tools.status_line import StatusLine
from tools.vehicle_telling import VehicleTelling

log = logging.getLogger(__name__)
_PERIOD_NS = 50_000_000


class LiveTelling:
    """See tools.session_parts.SessionPart; place_of: where the car is by another part, None: by this run's own map.

    fault: why the vehicle is told nothing more, empty where it is.
    """

    tells = False
    hurries = False
    needs_map = False

    def __init__(self, vehicle: Vehicle, bell: Bell, place_of: Callable[[], Located | None] | None = None) -> None:
        self._vehicle, self._bell, self._place_of = vehicle, bell, place_of
        self._told: _ToldVehicle | None = None
        self._thread: DriveThread | None = None

    @property
    def fault(self) -> str:
        """See above."""
        return "" if self._told is None else self._told.fault

    @property
    def failure(self) -> BaseException | None:
        """What the thread died of."""
        return None if self._thread is None else self._thread.failure

    def begin(self, session: LiveSession) -> None:
        """Begin to hear the vehicle and to tell it."""
        self._told = _ToldVehicle(self._vehicle, session)
        self._thread = DriveThread(self._told, self._vehicle, session.clock, self._bell, session.stop)
        self._thread.start()

    def note(self, message: Recordable) -> None:
        """Keep a scan to tell of."""
        if isinstance(message, LaserScan) and self._told is not None:
            self._told.telling.note_scan(message)

    def add(self, mapped: MappedScan) -> None:
        """Keep the pose to tell of."""
        if self._told is None or not mapped.match.accepted:
            return
        if self._place_of is not None:
            self._told.place = self._place_of()
        elif mapped.in_map:
            self._told.place = Located(
                mapped.stamp_ns, mapped.pose, mapped.T_map_odom, np.zeros((3, 3)), 1.0, "own map"
            )

    def end(self) -> None:
        """Tell no more."""
        if self._thread is not None:
            self._thread.end()

    def save(self, folder: Path) -> dict[str, Any]:
        """Return section `vehicle`; there is nothing to write."""
        del folder
        return {"vehicle": {"name": self._vehicle.name, "driven": False, "fault": self.fault or None}}


class _ToldVehicle:
    """See tools.drive_thread.Driven: nothing is commanded, so there is nothing to stop either."""

    armed = left = False

    def __init__(self, vehicle: Vehicle, session: LiveSession) -> None:
        self.fault = ""
        self.place: Located | None = None
        self.telling = VehicleTelling(vehicle, session.mount)
        self._vehicle, self._put = vehicle, session.put
        self._status = StatusLine()
        self._next_ns = 0

    def step(self, now_ns: int) -> object:
        """Hear the vehicle, and tell it what is new."""
        if self.fault or now_ns < self._next_ns:
            return None
        self._next_ns = now_ns + _PERIOD_NS
        try:
            for message in self._vehicle.poll():
                if isinstance(message, VehicleState):
                    self._status.vehicle(message)
                elif isinstance(message, Odometry | Imu):
                    self._put(message)
            self.telling.tell(self.place, now_ns)
        except DriverError as error:
            log.warning("the vehicle is told nothing more: %s; mapping and recording go on", error)
            self.fault = str(error)
        return None

    def emergency_stop(self, reason: str) -> None:
        """Nothing of ours drives it."""
        log.warning("%s: this run does not drive the car", reason)
