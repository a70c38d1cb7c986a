"""A rigid group of keyframes onto another one: point-to-line matching of all their overlapping pairs.

One keyframe against its predecessors, a piece of the drive against an earlier piece (loop closure) and a piece against
a saved map (relocalisation) are all the same: only which keyframes are moved and which stay differs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.keyframes import Clouds
from mapping.scan_pairs import agreement_of_pairs, pull_pairs

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

SIGMA_M = 0.02  # noise of one residual
EFFECTIVE_SHARE = 0.1  # neighbouring samples and both directions share errors: so much of the information is real


_FAKED_SHARE = 0.01  # of the strongest direction's information: normals are off by some 0.1 rad
_FLOOR = np.diag([0.02**2, 0.02**2, 0.005**2])


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Keyframes (G,) with their poses (G, 3) in the group's own frame."""

    keyframes: IndexArray
    poses: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class GroupMatch:
    """The pose (3,) of the moving group's frame in the fixed one's.

    information (3, 3) is what the walls say over x, y in the fixed frame and yaw, in 1/m^2 and 1/rad^2; pairs of
    samples, their rms in m.
    """

    pose: FloatArray
    information: FloatArray
    pairs: int
    rms_m: float

    @property
    def is_pinned_down(self) -> bool:
        """Whether walls of several directions hold the pose: along a plain corridor only the noise of normals does."""
        weak, strong = np.linalg.eigvalsh(self.information[:2, :2])
        return bool(weak > 2.0 * _FAKED_SHARE * strong)

    def information_with(self, prior: FloatArray | None = None) -> FloatArray:
        """Return the information (3, 3) in the moving frame, with a prior's in the fixed frame added.

        What noisy normals fake in a direction without walls is taken off, and nothing is better than _FLOOR.
        """
        values, vectors = np.linalg.eigh(self.information[:2, :2])
        values = np.maximum(values, 1e-9)
        kept = np.maximum(values - _FAKED_SHARE * values[1], 1e-3 * values)
        shrink = np.eye(3)
        shrink[:2, :2] = vectors @ np.diag(np.sqrt(kept / values)) @ vectors.T
        honest = shrink @ self.information @ shrink
        if prior is not None:
            honest = honest + prior
        cos, sin = np.cos(self.pose[2]), np.sin(self.pose[2])
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        covariance = np.linalg.inv(turn.T @ honest @ turn + 1e-3 * np.eye(3)) + _FLOOR
        return np.linalg.inv(covariance)


@dataclass(frozen=True, slots=True)
class Agreement:
    """Samples of either group that lie on the other's, that stand where the other saw through, that it cannot see."""

    hits: int
    conflicts: int
    hidden: int

    @property
    def hit_share(self) -> float:
        """Hits among the samples that the other group should have seen."""
        seen = self.hits + self.conflicts
        return self.hits / seen if seen else 0.0

    @property
    def overlap(self) -> float:
        """Hits among all samples."""
        total = self.hits + self.conflicts + self.hidden
        return self.hits / total if total else 0.0


def single(keyframe: int) -> Group:
    """Return one keyframe as a group, in its own frame."""
    return Group(np.array([keyframe], dtype=np.int64), np.zeros((1, 3)))


def match_groups(
    clouds: Clouds,
    moving: Group,
    fixed: Group,
    guess: FloatArray,
    gates_m: tuple[float, ...],
    *,
    prior: FloatArray | None = None,
    expected: FloatArray | None = None,
    stride: int = 1,
) -> GroupMatch:
    """Return the pose near the guess (3,) at which the moving group's samples lie best on the fixed group's walls.

    One Gauss-Newton step a gate; prior (3, 3) is the information of the expected pose (3,), the guess unless given,
    which holds what the walls leave open.
    """
    first, second = (index.ravel() for index in np.meshgrid(moving.keyframes, fixed.keyframes, indexing="ij"))
    row = np.repeat(np.arange(len(moving.keyframes)), len(fixed.keyframes))
    fixed_poses = np.tile(fixed.poses, (len(moving.keyframes), 1))
    pose = np.array(guess, dtype=np.float64)
    held = np.zeros((3, 3)) if prior is None else prior
    middle = guess if expected is None else expected
    for gate_m in gates_m:
        placed = se2.compose(pose, moving.poses)
        hessians, gradients, numbers, costs = pull_pairs(
            clouds.points, clouds.angles, clouds.normals, clouds.levels, clouds.reaches, clouds.starts, clouds.sensor,
            first, second, placed[row], fixed_poses, gate_m, 0.5 * gate_m, stride,
        )  # fmt: skip
        hessian, gradient = _of_group(hessians, gradients, placed[row], pose)
        believed = EFFECTIVE_SHARE * stride / SIGMA_M**2
        information = believed * hessian
        away = np.array([*(pose[:2] - middle[:2]), se2.wrap_angle(pose[2] - middle[2])])
        step = np.linalg.solve(information + held + 1e-6 * np.eye(3), -(believed * gradient + held @ away))
        pose = pose + np.clip(step, -0.5, 0.5)
        pose[2] = se2.wrap_angle(pose[2])
    pairs = int(numbers.sum())
    return GroupMatch(pose, information, pairs, float(np.sqrt(costs.sum() / pairs)) if pairs else 0.0)


def group_agreement(
    clouds: Clouds, moving: Group, fixed: Group, pose: FloatArray, tolerance_m: float, *, stride: int = 1
) -> Agreement:
    """Count, over all pairs and both ways, what the groups say of each other at a pose (3,) of moving in fixed."""
    first, second = (index.ravel() for index in np.meshgrid(moving.keyframes, fixed.keyframes, indexing="ij"))
    placed = np.repeat(se2.compose(pose, moving.poses), len(fixed.keyframes), axis=0)
    fixed_poses = np.tile(fixed.poses, (len(moving.keyframes), 1))
    forth, back = se2.between(fixed_poses, placed), se2.between(placed, fixed_poses)
    arguments = (clouds.points, clouds.angles, clouds.ranges, clouds.starts, clouds.sensor)
    counts = agreement_of_pairs(*arguments, first, second, forth, tolerance_m, stride)
    counts += agreement_of_pairs(*arguments, second, first, back, tolerance_m, stride)
    hits, conflicts, hidden = counts.tolist()
    return Agreement(hits, conflicts, hidden)


def _of_group(
    hessians: FloatArray, gradients: FloatArray, placed: FloatArray, pose: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return hessian (3, 3) and gradient (3,) over the group's pose: a turn also shifts keyframes off its origin."""
    jacobian = np.tile(np.eye(3), (len(placed), 1, 1))
    jacobian[:, 0, 2] = -(placed[:, 1] - pose[1])
    jacobian[:, 1, 2] = placed[:, 0] - pose[0]
    hessian = np.einsum("pba,pbc,pcd->ad", jacobian, hessians[:, :3, :3], jacobian)
    return hessian, np.einsum("pba,pb->a", jacobian, gradients[:, :3])
