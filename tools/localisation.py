"""Where the car is on a map that was there before: found, followed, and told (`run --map`, `replay --map`)."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.map_io import read_map_with_warnings
from mapping.map_tracking import MapLocaliser
from mapping.reference_map import reference_map
from mapping.slam import MappedScan
from mapping.trajectory import Trajectory, write_tum

log = logging.getLogger(__name__)

FloatArray = NDArray[np.float64]
LOCALISED_NAME = "trajectory_in_map.tum"


class Localisation:
    """Looks for the car on one map and follows it; sensor (2,) is the laser's place on the body."""

    def __init__(self, map_file: Path, sensor: FloatArray) -> None:
        self._file = map_file
        loaded = read_map_with_warnings(map_file)
        for warning in loaded.warnings:
            log.warning("%s", warning)
        self._localiser = MapLocaliser(reference_map(loaded.grid), sensor)
        self._stamps: list[int] = []
        self._poses: list[FloatArray] = []
        self._by_odometry = 0
        self._begun_ns: int | None = None
        self._found_after_s: float | None = None
        self._is_known = False

    def add(self, mapped: MappedScan) -> None:
        """Take in a scan that was matched; where the place is known, its pose on the map is kept."""
        if not mapped.match.accepted:
            return
        if self._begun_ns is None:
            self._begun_ns = mapped.stamp_ns
        place = self._localiser.add(mapped.stamp_ns, mapped.points, mapped.match.pose)
        if self._is_known and place is None:
            log.warning("%s: %s; looking for the car again", self._file, self._localiser.reason)
        if not self._is_known and place is not None:
            seconds = (mapped.stamp_ns - self._begun_ns) * 1e-9
            self._found_after_s = seconds if self._found_after_s is None else self._found_after_s
            x, y, yaw = place.T_map_base.tolist()
            log.info(
                "%s: found after %.1f s at x %.2f m, y %.2f m, %.0f deg (%s)",
                self._file, seconds, x, y, np.degrees(yaw), place.reason,
            )  # fmt: skip
        self._is_known = place is not None
        if place is not None:
            self._stamps.append(mapped.stamp_ns)
            self._poses.append(place.T_map_base)
            self._by_odometry += place.by_odometry

    def save(self, folder: Path) -> dict[str, object]:
        """Write the poses on the map, TUM text, where there are any; return what the report says of it."""
        trajectory = Trajectory(np.array(self._stamps, dtype=np.int64), np.array(self._poses).reshape(-1, 3))
        if len(trajectory):
            write_tum(folder / LOCALISED_NAME, trajectory)
        else:
            log.warning("%s: the car was NOT found on this map: %s", self._file, self._localiser.reason)
        return {
            "map": str(self._file),
            "found": len(trajectory) > 0,
            "found_after_s": self._found_after_s,
            "poses": len(trajectory),
            "by_odometry": self._by_odometry,
            "losses": self._localiser.losses,
            "reason": self._localiser.reason,
        }
