"""What was seen along the last metres of a drive: keyframes' points, held together by the odometry."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.surface import facings_of

FloatArray = NDArray[np.float64]

_KEYFRAME_M, _KEYFRAME_RAD = 0.2, np.radians(10.0)
_VOXEL_M = 0.1  # one point each: a point is then about a decimetre of wall


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """Points (N, 2) with the places (N, 2) they were seen from, and the metres driven (N,) when they were.

    facings_rad (N,): where the surface that a point lies on faces, see surface.facings_of.
    """

    points: FloatArray
    facings_rad: FloatArray
    origins: FloatArray
    driven_m: FloatArray


class LocalCloud:
    """Keeps the keyframes of the last length_m; sensor (2,): the laser's place on the body; all in m.

    Points farther than range_m are left out: one there is off by too much when the heading is a little.
    """

    def __init__(self, length_m: float, range_m: float, sensor: FloatArray) -> None:
        self._length_m = length_m
        self._range_m = range_m
        self._sensor = np.array(sensor, dtype=np.float64)
        self._keyframes: deque[tuple[float, FloatArray, FloatArray, FloatArray]] = deque()
        self._pose: FloatArray | None = None
        self.driven_m = 0.0
        self.turned_rad = 0.0

    def add(self, points_body: FloatArray, T_odom_base: FloatArray) -> bool:
        """Take in a scan (N, 2) if the body has moved enough since the last keyframe; return whether it has."""
        pose = np.array(T_odom_base, dtype=np.float64)
        if self._pose is not None:
            moved = se2.between(self._pose, pose)
            distance_m, turned_rad = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
            if distance_m < _KEYFRAME_M and turned_rad < _KEYFRAME_RAD:
                return False
            self.driven_m += distance_m
            self.turned_rad += turned_rad
        self._pose = pose
        near = np.hypot(*(points_body - self._sensor).T) <= self._range_m
        facings_rad = facings_of(points_body, self._sensor)[near]
        self._keyframes.append((self.driven_m, pose, np.asarray(points_body[near], dtype=np.float64), facings_rad))
        while self._keyframes[0][0] < self.driven_m - self._length_m:
            self._keyframes.popleft()
        return True

    def seen_from(self, T_odom_base: FloatArray, last_m: float | None = None) -> Sighting:
        """Return the points in the body frame at a pose (3,), one a square of 0.1 m: the one seen last.

        last_m: of that much driving only, None for all that is kept.
        """
        since_m = -np.inf if last_m is None else self.driven_m - last_m
        points, origins, driven, facings = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
        for driven_m, pose, seen, facings_rad in reversed(self._keyframes):
            if driven_m < since_m:
                break
            T_now_then = se2.between(T_odom_base, pose)
            points.append(se2.transform_points(T_now_then, seen))
            origins.append(np.broadcast_to(se2.transform_points(T_now_then, self._sensor), seen.shape))
            driven.append(np.full(len(seen), driven_m))
            facings.append(facings_rad + T_now_then[2])
        cloud = np.vstack(points)
        squares = np.floor(cloud / _VOXEL_M).astype(np.int64)
        kept = np.unique(squares, axis=0, return_index=True)[1]  # in the order of place, not of time
        return Sighting(
            cloud[kept], np.concatenate(facings)[kept], np.vstack(origins)[kept], np.concatenate(driven)[kept]
        )
