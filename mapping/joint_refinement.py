"""All keyframes against each other: point to line over every overlapping pair at once, after the pose graph.

Sparse Gauss-Newton over all poses: Lu and Milios, "Globally consistent range scan alignment for environment mapping"
(Autonomous Robots 1997), with point-to-line residuals and new correspondences in each sweep. A pair's normal equations
are summed where they are made, so memory grows with the pairs and not with their samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping import se2
from mapping.keyframes import Clouds
from mapping.pose_graph import Constraints, NormalEquations, linearise, robust_weights
from mapping.scan_matching import EFFECTIVE_SHARE, SIGMA_M
from mapping.scan_pairs import agreement, pull_pairs

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]

_NEIGHBOURS_IN_TIME = 3  # always partners
_ONE_PASS = 20  # keyframes so close in number belong to one pass
_OVERLAP_STRIDE = 6  # samples are sparse where overlaps are only compared
_TOLERANCE_M = 0.15


@dataclass(frozen=True, slots=True)
class RefinementSettings:
    """How keyframes are refined.

    reach_m: keyframes farther apart are no partners, and of those nearer `most_compared` are compared. partners: so
    many with the best overlap, at least least_overlap, are kept for each keyframe; passes before the present one have
    precedence. gates_m: residuals beyond are left out, one sweep a gate; the last full_sweeps use every sample, those
    before every second. Pairs are chosen anew every `renewed` sweeps.
    prior_m, prior_rad: what the front end's steps are trusted with, so that no corridor slides.
    """

    reach_m: float = 8.0
    most_compared: int = 80
    partners: int = 12
    least_overlap: float = 0.3
    gates_m: tuple[float, ...] = (0.3, 0.2, 0.1, 0.08, 0.06, 0.06)
    full_sweeps: int = 2
    renewed: int = 3
    prior_m: float = 0.02
    prior_rad: float = 0.005


def refine_jointly(
    clouds: Clouds,
    poses: FloatArray,
    constraints: Constraints,
    settings: RefinementSettings,
    *,
    kernel: float,
    cancelled: Callable[[], bool],
) -> FloatArray | None:
    """Return refined poses (K, 3), K >= 2; None if cancelled between two sweeps. Pose 0 stays.

    constraints are the pose graph's: steps of the front end and, marked robust, the closures.
    """
    current = np.array(poses, dtype=np.float64)
    held = _with_prior(constraints, current, settings)
    believed = EFFECTIVE_SHARE / SIGMA_M**2
    first = second = np.zeros(0, np.int64)
    for sweep, gate_m in enumerate(settings.gates_m):
        if sweep % settings.renewed == 0:
            first, second = choose_pairs(clouds, current, settings)
        if cancelled():
            return None
        stride = 1 if sweep >= len(settings.gates_m) - settings.full_sweeps else 2
        hessians, gradients, _, _ = pull_pairs(
            clouds.points, clouds.angles, clouds.normals, clouds.levels, clouds.reaches, clouds.starts, clouds.sensor,
            first, second, current[first], current[second], gate_m, 0.5 * gate_m, stride,
        )  # fmt: skip
        equations = NormalEquations(len(current), 0)
        equations.add(first, second, stride * believed * hessians, stride * believed * gradients)
        equations.add(held.first, held.second, *linearise(current, held, robust_weights(current, held, kernel)))
        current = current + equations.solve(1e-9)
        current[:, 2] = se2.wrap_angle(current[:, 2])
    return current


def choose_pairs(clouds: Clouds, poses: FloatArray, settings: RefinementSettings) -> tuple[IndexArray, IndexArray]:
    """Return the pairs (P,), (P,) of keyframes that are matched: each with those that it overlaps most."""
    compared = [_near(poses, keyframe, settings) for keyframe in range(len(poses))]
    starts = np.concatenate([[0], np.cumsum([len(others) for others in compared])]).astype(np.int64)
    others = np.concatenate(compared)
    shares = _overlaps(
        clouds.points, clouds.angles, clouds.ranges, clouds.starts, clouds.sensor, poses, others, starts,
        _TOLERANCE_M, _OVERLAP_STRIDE,
    )  # fmt: skip
    chosen = [
        _best_partners(keyframe, others[first:last], shares[first:last], settings)
        for keyframe, (first, last) in enumerate(pairwise(starts))
    ]
    first = np.repeat(np.arange(len(poses), dtype=np.int64), [len(each) for each in chosen])
    return first, np.concatenate(chosen)


def _near(poses: FloatArray, keyframe: int, settings: RefinementSettings) -> IndexArray:
    """Return keyframes within reach: the neighbours in time, and of the others an even choice of the nearest."""
    distance = np.hypot(*(poses[:, :2] - poses[keyframe, :2]).T)
    near: IndexArray = np.flatnonzero(distance <= settings.reach_m)
    near = near[near != keyframe]
    if len(near) <= settings.most_compared:
        return near
    in_time = np.abs(near - keyframe) <= 2 * _NEIGHBOURS_IN_TIME
    far = near[~in_time]
    far = far[np.argsort(distance[far], kind="stable")[: 2 * settings.most_compared]][::2]
    return np.concatenate([near[in_time], far])


def _best_partners(keyframe: int, others: IndexArray, shares: FloatArray, settings: RefinementSettings) -> IndexArray:
    """Return the partners of one keyframe: its neighbours in time, then earlier and later passes, then its own pass."""
    good = shares > settings.least_overlap
    others, shares = others[good], shares[good]
    apart = np.abs(others - keyframe)
    ranked = np.argsort(-shares, kind="stable")
    in_time = others[apart <= _NEIGHBOURS_IN_TIME]
    ranked = ranked[apart[ranked] > _NEIGHBOURS_IN_TIME]
    elsewhere = others[ranked[apart[ranked] > _ONE_PASS]][: settings.partners - _NEIGHBOURS_IN_TIME]
    own_pass = others[ranked[apart[ranked] <= _ONE_PASS]][: settings.partners - len(elsewhere)]
    return np.concatenate([in_time, elsewhere, own_pass])


def _with_prior(constraints: Constraints, poses: FloatArray, settings: RefinementSettings) -> Constraints:
    """Return the constraints with the steps as the graph left them, trusted as the settings say; weak ones stay weak.

    A step that closures have set right, along a corridor perhaps, must not be drawn back to what was measured.
    """
    prior = np.diag([settings.prior_m**-2.0, settings.prior_m**-2.0, settings.prior_rad**-2.0])
    steps = ~constraints.robust & (constraints.information[:, 2, 2] > 1.0)
    information = np.where(steps[:, None, None], prior, constraints.information)
    settled = se2.between(poses[constraints.first], poses[constraints.second])
    relative = np.where(steps[:, None], settled, constraints.T_first_second)
    return Constraints(constraints.first, constraints.second, relative, information, constraints.robust)


@njit(cache=True, nogil=True)
def _overlaps(
    points: Float32Array,
    angles: Float32Array,
    ranges: Float32Array,
    starts: IndexArray,
    sensor: FloatArray,
    poses: FloatArray,
    others: IndexArray,
    other_starts: IndexArray,
    tolerance: float,
    stride: int,
) -> FloatArray:
    """Return the share (P,) of a keyframe's samples that lie on each of the others listed for it."""
    shares = np.zeros(len(others))
    relative = np.empty(3)
    for keyframe in range(len(other_starts) - 1):
        for place in range(other_starts[keyframe], other_starts[keyframe + 1]):
            other = others[place]
            cos, sin = np.cos(poses[other, 2]), np.sin(poses[other, 2])
            dx, dy = poses[keyframe, 0] - poses[other, 0], poses[keyframe, 1] - poses[other, 1]
            relative[0], relative[1] = cos * dx + sin * dy, -sin * dx + cos * dy
            relative[2] = poses[keyframe, 2] - poses[other, 2]
            hits, conflicts, hidden = agreement(
                points, angles, ranges, starts, sensor, keyframe, other, relative, tolerance, stride
            )
            shares[place] = hits / max(1, hits + conflicts + hidden)
    return shares
