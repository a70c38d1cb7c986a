"""What a vehicle is told of: where it is on the map, and what stands around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan
from drivers.vehicle import Vehicle
from mapping import se2
from mapping.mount import Mount
from mapping.relocalisation import Located

FloatArray = NDArray[np.float64]

_JUMP_M, _JUMP_RAD = 0.1, 0.05  # a correction of the place in one step that is none of driving
_OLDEST_POSE_S = 0.5


class VehicleTelling:
    """Tells each place and each scan once; mount: the laser on the car."""

    def __init__(self, vehicle: Vehicle, mount: Mount) -> None:
        self._vehicle, self._mount = vehicle, mount
        self._scan: LaserScan | None = None
        self._told = PoseTold()

    def note_scan(self, scan: LaserScan) -> None:
        """Take a scan to be told of next; may come from another thread."""
        self._scan = scan

    def tell(self, place: Located | None, now_ns: int) -> None:
        """Tell what is new; raises DriverError."""
        if place is not None and self._told.is_new(place):
            pose, twist, jumped = self._told.take(place, now_ns)
            self._vehicle.tell_pose(now_ns, pose, twist, jumped=jumped)
        scan, self._scan = self._scan, None
        if scan is not None:
            if self._mount.inverted:
                scan = replace(scan, angles_rad=-scan.angles_rad)
            self._vehicle.tell_scan(scan, self._mount.pose)


class PoseTold:
    """Poses and twists for the vehicle out of the places on the map, and whether the place was corrected in between."""

    def __init__(self) -> None:
        self._last: Located | None = None
        self._twist = np.zeros(3)

    def is_new(self, place: Located) -> bool:
        """Whether this place was not told yet."""
        return self._last is None or place.stamp_ns > self._last.stamp_ns

    def take(self, place: Located, now_ns: int) -> tuple[FloatArray, FloatArray, bool]:
        """Return the pose (3,) of now by the twist (3,) in base_link, and whether it jumped since the last place."""
        last, self._last = self._last, place
        jumped = False
        if last is not None:
            driven = se2.between(_in_odom(last), _in_odom(place))
            self._twist = driven / ((place.stamp_ns - last.stamp_ns) * 1e-9)
            off = se2.between(se2.compose(last.T_map_base, driven), place.T_map_base)
            jumped = bool(np.hypot(off[0], off[1]) > _JUMP_M or abs(off[2]) > _JUMP_RAD)
        age_s = min(max((now_ns - place.stamp_ns) * 1e-9, 0.0), _OLDEST_POSE_S)
        return se2.compose(place.T_map_base, self._twist * age_s), self._twist, jumped


def _in_odom(place: Located) -> FloatArray:
    return se2.between(place.T_map_odom, place.T_map_base)
