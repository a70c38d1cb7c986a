"""A path as a follower wants it: dense poses, the gear and the speed at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]
TOP_SPEED_MPS = 0.5
_CREEP_MPS = 0.05  # where the car stops to change gear, so that it arrives at all
_LATERAL_MPS2, _ACCELERATION_MPS2 = 0.5, 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """poses (N, 3) of base_link in the map frame; direction (N,) 1 forward or -1; speed_mps (N,), 0 at the end.

    direction and speed are those of the motion that leaves the pose, at the last one of the motion that reaches it.
    """

    poses: FloatArray
    direction: NDArray[np.int8]
    speed_mps: FloatArray

    @property
    def length_m(self) -> float:
        """Distance driven by base_link, forwards and backwards."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


def path_along(poses: FloatArray) -> Path:
    """Give dense poses (N, 3), N >= 1, their gear and speed."""
    if len(poses) < 2:
        return Path(poses, np.ones(len(poses), np.int8), np.zeros(len(poses)))
    steps = np.diff(poses, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    middle = poses[:-1, 2] + se2.wrap_angle(steps[:, 2]) / 2.0
    gear = np.where(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle) < 0.0, -1, 1).astype(np.int8)
    curvature = np.abs(se2.wrap_angle(steps[:, 2])) / np.maximum(lengths, 1e-6)
    limit = np.minimum(TOP_SPEED_MPS, np.sqrt(_LATERAL_MPS2 / np.maximum(curvature, 1e-6)))
    limit = np.append(limit, 0.0)
    changes = np.flatnonzero(np.diff(gear)) + 1
    limit[changes] = _CREEP_MPS
    limit[0] = min(limit[0], _CREEP_MPS)
    return Path(poses, np.append(gear, gear[-1]), _with_acceleration(limit, lengths))


def _with_acceleration(limit: FloatArray, lengths: FloatArray) -> FloatArray:
    """Lower limits (N,) so that speeding up and braking over steps (N - 1,) stay gentle."""
    speed: FloatArray = limit.copy()
    for i in range(1, len(speed)):
        speed[i] = min(speed[i], np.sqrt(speed[i - 1] ** 2 + 2.0 * _ACCELERATION_MPS2 * lengths[i - 1]))
    for i in range(len(speed) - 2, -1, -1):
        speed[i] = min(speed[i], np.sqrt(speed[i + 1] ** 2 + 2.0 * _ACCELERATION_MPS2 * lengths[i]))
    return speed
