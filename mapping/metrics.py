"""How far an estimated trajectory is from the truth.

Source of the absolute trajectory error, its alignment and the relative pose error: Sturm et al., "A benchmark for the
evaluation of RGB-D SLAM systems" (IROS 2012); the closed form of the planar alignment is the 2-D case of Umeyama (PAMI
1991) without scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]
DeltaUnit = Literal["m", "s"]

_INTERVAL_SLACK = 0.5  # a pair whose interval is off by more than this share of the wanted one is left out


@dataclass(frozen=True, slots=True)
class TrajectoryError2D:
    """Errors over the poses that truth covers: metres and degrees; T_truth_estimate aligned the two frames.

    uncovered: poses of the estimate outside the time of truth. truth_covered: share of the true poses within the time
    of the estimate; an estimate that ended early shows here.
    """

    poses: int
    uncovered: int
    truth_covered: float
    rms_m: float
    mean_m: float
    median_m: float
    max_m: float
    rms_deg: float
    mean_deg: float
    median_deg: float
    max_deg: float
    T_truth_estimate: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RelativePoseError:
    """Errors in m and deg of the motion over an interval, over all `pairs` of poses that far apart.

    interval: the mean of what was found for the wanted delta, in delta_unit: s, or m along the true path.
    """

    delta: float
    delta_unit: DeltaUnit
    pairs: int
    interval: float
    rms_m: float
    mean_m: float
    median_m: float
    max_m: float
    rms_deg: float
    mean_deg: float
    median_deg: float
    max_deg: float


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
    covered, true = _true_poses(estimate, truth)
    estimated = estimate.poses[covered]
    first = se2.compose(true[0], se2.inverse(estimated[0]))
    T_truth_estimate = align_points(true[:, :2], estimated[:, :2]) if align and covered.sum() > 1 else first
    moved = se2.compose(T_truth_estimate, estimated)
    distance = np.hypot(*(moved - true)[:, :2].T)
    turn = np.degrees(np.abs(se2.wrap_angle(moved[:, 2] - true[:, 2])))
    x, y, yaw = (float(value) for value in T_truth_estimate)
    within = (truth.stamps_ns >= estimate.stamps_ns[0]) & (truth.stamps_ns <= estimate.stamps_ns[-1])
    return TrajectoryError2D(
        poses=int(covered.sum()),
        uncovered=int((~covered).sum()),
        truth_covered=float(within.mean()),
        **_spread(distance, "m"),
        **_spread(turn, "deg"),
        T_truth_estimate=(x, y, yaw),
    )


def relative_pose_error(
    estimate: Trajectory, truth: Trajectory, delta: float, delta_unit: DeltaUnit
) -> RelativePoseError:
    """Compare motions over delta (s, or m along the true path) with those of truth interpolated at the same stamps.

    Each pose is paired with the one whose interval comes closest to delta; a pair that misses it by more than half is
    left out. Raises ValueError when truth covers no pose of the estimate, or no two are that far apart.
    """
    if not (np.isfinite(delta) and delta > 0.0):
        raise ValueError(f"the interval must be positive, got {delta} {delta_unit}")
    covered, true = _true_poses(estimate, truth)
    estimated = estimate.poses[covered]
    if delta_unit == "s":
        along = (estimate.stamps_ns[covered] - estimate.stamps_ns[covered][0]) * 1e-9
    else:
        steps = np.hypot(*np.diff(true[:, :2], axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
    first = np.arange(len(along))
    after = np.clip(np.searchsorted(along, along + delta), 0, len(along) - 1)
    before = np.maximum(after - 1, first)
    nearer_before = np.abs(along[before] - along - delta) < np.abs(along[after] - along - delta)
    second = np.where(nearer_before, before, after)
    interval = along[second] - along
    is_inside = along + delta <= along[-1] + 1e-6  # the last poses have no partner so far away
    kept = is_inside & (np.abs(interval - delta) <= _INTERVAL_SLACK * delta)
    if not kept.any():
        raise ValueError(f"no two poses are about {delta:g} {delta_unit} apart: choose another interval")
    first, second = first[kept], second[kept]
    error = se2.between(se2.between(true[first], true[second]), se2.between(estimated[first], estimated[second]))
    return RelativePoseError(
        delta=delta,
        delta_unit=delta_unit,
        pairs=int(kept.sum()),
        interval=float(interval[kept].mean()),
        **_spread(np.hypot(error[:, 0], error[:, 1]), "m"),
        **_spread(np.degrees(np.abs(error[:, 2])), "deg"),
    )


def _true_poses(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which poses of the estimate truth covers, and the true poses at their stamps; raises ValueError."""
    if len(truth) == 0:
        raise ValueError("the true trajectory is empty: the two have no time in common")
    covered = (estimate.stamps_ns >= truth.stamps_ns[0]) & (estimate.stamps_ns <= truth.stamps_ns[-1])
    if not covered.any():
        raise ValueError("the two trajectories have no time in common")
    return covered, truth.at(estimate.stamps_ns[covered])


def _spread(errors: FloatArray, unit: str) -> dict[str, float]:
    """Return rms, mean, median and max under the names of the fields."""
    return {
        f"rms_{unit}": float(np.sqrt((errors**2).mean())),
        f"mean_{unit}": float(errors.mean()),
        f"median_{unit}": float(np.median(errors)),
        f"max_{unit}": float(errors.max()),
    }
