"""Where the car is on a map that was there before: found, followed, and told (`run --map`, `replay --map`)."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Recordable
from mapping.map_tracking import MapLocaliser
from mapping.reference_map import reference_map
from mapping.relocalisation import Located
from mapping.slam import MappedScan
from mapping.trajectory import Trajectory, write_tum
from tools.map_reading import read_saved
from tools.session_parts import LiveSession

log = logging.getLogger(__name__)

FloatArray = NDArray[np.float64]
LOCALISED_NAME = "trajectory_in_map.tum"


class PlacesOnMap:
    """Keeps where the car was on a saved map, and tells when it is found and when it is lost."""

    def __init__(self, map_file: Path) -> None:
        self._file = map_file
        self._reason = "no scan yet"
        self._stamps: list[int] = []
        self._poses: list[FloatArray] = []
        self._by_odometry = self._losses = 0
        self._begun_ns: int | None = None
        self._found_after_s: float | None = None
        self._is_known = False

    def add(self, stamp_ns: int, place: Located | None, reason: str) -> None:
        """Take in the place at a scan, None where it is not known, and what it rests on or why there is none."""
        self._reason = reason
        if self._begun_ns is None:
            self._begun_ns = stamp_ns
        if self._is_known and place is None:
            self._losses += 1
            log.warning("%s: %s; looking for the car again", self._file, reason)
        if not self._is_known and place is not None:
            seconds = (stamp_ns - self._begun_ns) * 1e-9
            self._found_after_s = seconds if self._found_after_s is None else self._found_after_s
            x, y, yaw = place.T_map_base.tolist()
            log.info(
                "%s: found after %.1f s at x %.2f m, y %.2f m, %.0f deg (%s)",
                self._file, seconds, x, y, np.degrees(yaw), reason,
            )  # fmt: skip
        self._is_known = place is not None
        if place is not None:
            self._stamps.append(stamp_ns)
            self._poses.append(place.T_map_base)
            self._by_odometry += place.by_odometry

    def save(self, folder: Path) -> dict[str, object]:
        """Write the poses on the map, TUM text, where there are any; return what the report says of it."""
        trajectory = Trajectory(np.array(self._stamps, dtype=np.int64), np.array(self._poses).reshape(-1, 3))
        if len(trajectory):
            write_tum(folder / LOCALISED_NAME, trajectory)
        else:
            log.warning("%s: the car was NOT found on this map: %s", self._file, self._reason)
        return {
            "map": str(self._file),
            "found": len(trajectory) > 0,
            "found_after_s": self._found_after_s,
            "poses": len(trajectory),
            "by_odometry": self._by_odometry,
            "losses": self._losses,
            "reason": self._reason,
        }


class Localisation:
    """Looks for the car on one map and follows it; sensor (2,) is the laser's place on the body."""

    def __init__(self, map_file: Path, sensor: FloatArray) -> None:
        self._places = PlacesOnMap(map_file)
        self._localiser = MapLocaliser(reference_map(read_saved(map_file)), sensor)

    def add(self, mapped: MappedScan) -> Located | None:
        """Take in a scan that was matched; where the place is known, its pose on the map is kept, and returned."""
        if not mapped.match.accepted:
            return None
        place = self._localiser.add(mapped.stamp_ns, mapped.points, mapped.match.pose)
        self._places.add(mapped.stamp_ns, place, self._localiser.reason)
        return place

    def save(self, folder: Path) -> dict[str, object]:
        """Write the poses on the map; return what the report says of it."""
        return self._places.save(folder)


class FoundOnMap:
    """A part of a live session (tools/session_parts.py): the car is looked for on a saved map and followed there."""

    tells = False
    hurries = False
    needs_map = False

    def __init__(self, map_file: Path) -> None:
        self._file = map_file
        self._localisation: Localisation | None = None
        self.place: Located | None = None

    def begin(self, session: LiveSession) -> None:
        """Read the map."""
        self._localisation = Localisation(self._file, session.mount.pose[:2])

    def note(self, message: Recordable) -> None:
        """Nothing: scans count once they are matched."""

    def add(self, mapped: MappedScan) -> None:
        """Follow the car."""
        if self._localisation is not None:
            self.place = self._localisation.add(mapped)

    def end(self) -> None:
        """Nothing is to be ended."""

    def save(self, folder: Path) -> dict[str, Any]:
        """Write the poses on the map."""
        return {} if self._localisation is None else {"localisation": self._localisation.save(folder)}
