"""How far an estimated trajectory is from the truth.

Source of the absolute trajectory error and its alignment: Sturm et al., "A benchmark for the evaluation of RGB-D SLAM
systems" (IROS 2012); the closed form of the planar alignment is the 2-D case of Umeyama (PAMI 1991) without scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrajectoryError2D:
    """Errors over the poses that truth covers: metres and degrees; T_truth_estimate aligned the two frames."""

    poses: int
    rms_m: float
    mean_m: float
    max_m: float
    mean_deg: float
    max_deg: float
    T_truth_estimate: tuple[float, float, float]


def align_points(target: FloatArray, source: FloatArray) -> FloatArray:
    """Return the pose (3,) that carries source (N, 2) onto target (N, 2) with the least squared distance."""
    center_t, center_s = target.mean(axis=0), source.mean(axis=0)
    t, s = target - center_t, source - center_s
    yaw = np.arctan2((s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]).sum(), (s * t).sum())
    shift = center_t - se2.transform_points(np.array([0.0, 0.0, yaw]), center_s)
    return np.array([shift[0], shift[1], yaw])


def absolute_trajectory_error(estimate: Trajectory, truth: Trajectory, *, align: bool = True) -> TrajectoryError2D:
    """Compare the estimate with truth interpolated at its stamps.

    With align=False the two frames are taken to meet at the first common pose instead of by least squares. Raises
    ValueError when truth covers no pose of the estimate.
    """
    if len(truth) == 0:
        raise ValueError("the true trajectory is empty: the two have no time in common")
    covered = (estimate.stamps_ns >= truth.stamps_ns[0]) & (estimate.stamps_ns <= truth.stamps_ns[-1])
    if not covered.any():
        raise ValueError("the two trajectories have no time in common")
    estimated, true = estimate.poses[covered], truth.at(estimate.stamps_ns[covered])
    first = se2.compose(true[0], se2.inverse(estimated[0]))
    T_truth_estimate = align_points(true[:, :2], estimated[:, :2]) if align and covered.sum() > 1 else first
    moved = se2.compose(T_truth_estimate, estimated)
    distance = np.hypot(*(moved - true)[:, :2].T)
    turn = np.degrees(np.abs(se2.wrap_angle(moved[:, 2] - true[:, 2])))
    x, y, yaw = (float(value) for value in T_truth_estimate)
    return TrajectoryError2D(
        poses=int(covered.sum()),
        rms_m=float(np.sqrt((distance**2).mean())),
        mean_m=float(distance.mean()),
        max_m=float(distance.max()),
        mean_deg=float(turn.mean()),
        max_deg=float(turn.max()),
        T_truth_estimate=(x, y, yaw),
    )
