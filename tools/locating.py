"""Where the car is on a saved map: from where it is told to stand, or from nothing, and again once it is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_tracking import MapLocaliser, MapTracker, TrackingSettings
from mapping.reference_map import reference_map
from mapping.relocalisation import Located, RelocalisationSettings
from mapping.slam import MappedScan

FloatArray = NDArray[np.float64]

_HINT = "; push the car on, or tell it where it stands"  # a car that stands sees nothing new
# A car that stands sees one scan, of some 20 m of walls (200 points); to count at once it must fit better than usual.
STANDING = RelocalisationSettings(sure_points=150, sure_hits=0.95)
_FIRST = 5  # scans that make the place exact that the car is told
_TOLD_M, _TOLD_RAD = 0.1, 0.1  # standard deviations of that


class Locating:
    """Follows the car from guess (3,) in the map's frame; where that is None or does not fit, looks for it everywhere.

    sensor (2,): the laser's place on the body. reason: what the place rests on, or why there is none.
    """

    def __init__(
        self, saved: OccupancyGrid, guess: FloatArray | None, sensor: FloatArray, settings: TrackingSettings
    ) -> None:
        self.reason = "no scan yet"
        self._map = reference_map(saved)
        self._sensor, self._settings = sensor, settings
        self._guess = None if guess is None else np.array(guess, dtype=np.float64)
        self._tracker: MapTracker | None = None
        self._first = 0
        self._everywhere = MapLocaliser(self._map, sensor, STANDING, settings)

    def add(self, mapped: MappedScan) -> Located | None:
        """Take in a scan whose match was accepted; return where it was made, None where that is not known."""
        if self._guess is None:
            place = self._everywhere.add(mapped.stamp_ns, mapped.points, mapped.match.pose)
            self.reason = self._everywhere.reason + (_HINT if place is None else "")
            return place
        return self._followed(mapped, self._guess)

    def _followed(self, mapped: MappedScan, guess: FloatArray) -> Located | None:
        """Follow the car from where it was told to be; the first scans do not count as driving."""
        if self._tracker is None:
            T_map_odom = se2.compose(guess, se2.inverse(mapped.match.pose))
            spread = np.diag([_TOLD_M, _TOLD_M, _TOLD_RAD]) ** 2
            told = Located(mapped.stamp_ns, guess, T_map_odom, spread, 0.0, "told")
            self._tracker = MapTracker(self._map, told, replace(self._settings, step_m=0.0), self._sensor)
        place = self._tracker.add(mapped.stamp_ns, mapped.points, mapped.match.pose)
        self.reason = self._tracker.reason
        if self._first < _FIRST:
            return self._settled(place)
        if place is None:
            self._guess = None
        return place

    def _settled(self, place: Located | None) -> Located | None:
        """Count a first scan; return the place once it is exact."""
        self._first += 1
        if self._first < _FIRST:
            self.reason = f"scan {self._first} of {_FIRST} that make the told place exact"
            return None
        if place is None or place.by_odometry:
            self._guess = None
            self.reason = f"it is not where it was told to be ({self.reason})"
            return None
        self._tracker = MapTracker(self._map, place, self._settings, self._sensor)
        return place
