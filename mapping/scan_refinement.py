"""The scans between keyframes, each onto the refined keyframes around it: the last step of the joint refinement."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.keyframes import Clouds
from mapping.scan_matching import EFFECTIVE_SHARE, SIGMA_M
from mapping.scan_pairs import pull
from mapping.surface import Surface

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]

_GATES_M = np.array([0.2, 0.1, 0.06])
_PARTNERS = 6
_PRIOR_M, _PRIOR_RAD = 0.02, 0.005  # what the front end's motion since the keyframe is trusted with


def refine_scan(
    clouds: Clouds, scan: Surface, guess: FloatArray, partners: IndexArray, poses: FloatArray
) -> FloatArray:
    """Return the refined pose (3,) of a scan, near its guess, on the keyframes partners (P,) at poses (P, 3)."""
    refined: FloatArray = _refine(
        scan.points.astype(np.float32), scan.normals.astype(np.float32), scan.reaches.astype(np.float32),
        clouds.points, clouds.angles, clouds.normals, clouds.levels, clouds.reaches, clouds.starts, clouds.sensor,
        guess, partners, poses, _GATES_M, EFFECTIVE_SHARE / SIGMA_M**2, _PRIOR_M, _PRIOR_RAD,
    )  # fmt: skip
    return refined


def partners_of(pose: FloatArray, keyframe: int, keyframe_poses: FloatArray) -> IndexArray:
    """Return the keyframes to match a scan at a pose (3,) with: those before and after it, and the nearest others."""
    distance = np.hypot(*(keyframe_poses[:, :2] - pose[:2]).T)
    nearest = np.argpartition(distance, min(2 * _PARTNERS, len(distance) - 1))[: 2 * _PARTNERS]
    nearest = nearest[np.lexsort((nearest, distance[nearest]))]
    own = np.arange(keyframe, min(keyframe + 2, len(keyframe_poses)))
    return np.concatenate([own, nearest[~np.isin(nearest, own)]])[:_PARTNERS].astype(np.int64)


@njit(cache=True, nogil=True)
def _refine(
    own_points: Float32Array,
    own_normals: Float32Array,
    own_reaches: Float32Array,
    points: Float32Array,
    angles: Float32Array,
    normals: Float32Array,
    levels: Float32Array,
    reaches: Float32Array,
    starts: IndexArray,
    sensor: FloatArray,
    guess: FloatArray,
    partners: IndexArray,
    poses: FloatArray,
    gates: FloatArray,
    believed: float,
    prior_m: float,
    prior_rad: float,
) -> FloatArray:
    """Return the pose after one Gauss-Newton step a gate."""
    pose: FloatArray = guess.copy()
    prior = np.array([prior_m**-2.0, prior_m**-2.0, prior_rad**-2.0])
    for gate in gates:
        hessian, gradient = np.zeros((6, 6)), np.zeros(6)
        for place in range(len(partners)):
            fixed = partners[place]
            pull(
                own_points, own_normals, own_reaches, 0, len(own_points),
                points, angles, normals, levels, reaches, starts[fixed], starts[fixed + 1], sensor,
                pose, poses[place], gate, 0.5 * gate, 1, hessian, gradient,
            )  # fmt: skip
        left, right = np.zeros((3, 3)), np.zeros(3)
        for a in range(3):
            right[a] = believed * gradient[a] + prior[a] * (pose[a] - guess[a])
            for b in range(3):
                left[a, b] = believed * (hessian[a, b] if b >= a else hessian[b, a])
            left[a, a] += prior[a]
        pose = pose - np.linalg.solve(left, right)
    return pose
