"""Stage 4 of Algorithm 3: the motion that most matches agree on, by MSAC (thesis section 3.5, Algorithm 2).

Two models of section 4.1.3.1: the rigid motion, and the similarity, whose scale is estimated as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.metrics import align_points

FloatArray = NDArray[np.float64]
_BATCH = 250  # trials at once
_REFITS = 3
_MAX_SCALE = 4.0  # either way; a motion that shrinks a map to a point fits everything


@dataclass(frozen=True, slots=True, eq=False)
class Consensus:
    """Which of the matches (M,) are inliers of the motion a = scale * R b + t, and R and t as a pose T_a_b (3,)."""

    T_a_b: FloatArray
    inliers: NDArray[np.bool_]
    scale: float = 1.0


def find_consensus(
    points_a: FloatArray,
    points_b: FloatArray,
    tolerance_m: float,
    *,
    trials: int,
    confidence: float,
    seed: int,
    free_scale: bool = False,
) -> Consensus | None:
    """Return the motion with the lowest MSAC cost over matched points (M, 2) in m; None without any.

    It is rigid, or with free_scale a similarity. The cost is (3.12) with (3.14), whose lines both compare e^2 with
    tolerance^2 (the thesis's first line lacks the square). Trials end early once `confidence` is reached that a sample
    without outliers was among them.
    """
    if len(points_a) < 2:
        return None
    random = np.random.default_rng(seed)
    best, best_cost, done, needed = None, math.inf, 0, float(trials)
    while done < min(trials, needed):
        samples = _samples(len(points_a), random, min(_BATCH, trials - done))
        motions = _hypotheses(points_a, points_b, samples, tolerance_m, free_scale)
        done += _BATCH
        if len(motions) == 0:
            continue
        costs = _costs(points_a, points_b, motions, tolerance_m)
        lowest = int(np.argmin(costs))
        if costs[lowest] < best_cost:
            best, best_cost = motions[lowest], float(costs[lowest])
            share = np.count_nonzero(_squared_errors(points_a, points_b, best) < tolerance_m**2) / len(points_a)
            needed = math.log(1.0 - confidence) / math.log1p(-min(share**2, 1.0 - 1e-12)) if share else math.inf
    return None if best is None else _refit(points_a, points_b, best, tolerance_m, free_scale)


def _samples(matches: int, random: np.random.Generator, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return count pairs of two different matches, as indices (count,) of the first and of the second."""
    first = random.integers(0, matches, count)
    return first, (first + random.integers(1, matches, count)) % matches


def _hypotheses(
    points_a: FloatArray,
    points_b: FloatArray,
    samples: tuple[NDArray[np.intp], NDArray[np.intp]],
    tolerance_m: float,
    free_scale: bool,
) -> FloatArray:
    """Return motions (H, 4), x, y, yaw, scale, through two matches each; rigid where their lengths agree."""
    first, second = samples
    side_a, side_b = points_a[second] - points_a[first], points_b[second] - points_b[first]
    length_a, length_b = np.hypot(*side_a.T), np.hypot(*side_b.T)
    fits = (length_a > tolerance_m) & (length_b > tolerance_m)
    if free_scale:
        fits &= (length_a < _MAX_SCALE * length_b) & (length_b < _MAX_SCALE * length_a)
    else:
        fits &= np.abs(length_a - length_b) <= 2.0 * tolerance_m
    first, second, side_a, side_b = first[fits], second[fits], side_a[fits], side_b[fits]
    scale = length_a[fits] / length_b[fits] if free_scale else np.ones(len(first))
    turn = np.arctan2(side_a[:, 1], side_a[:, 0]) - np.arctan2(side_b[:, 1], side_b[:, 0])
    turns = np.column_stack([np.zeros((len(turn), 2)), turn])
    middle_a, middle_b = (points_a[first] + points_a[second]) / 2.0, (points_b[first] + points_b[second]) / 2.0
    shift = middle_a - se2.transform_points(turns, scale[:, np.newaxis] * middle_b)
    return np.column_stack([shift, se2.wrap_angle(turn), scale])


def _squared_errors(points_a: FloatArray, points_b: FloatArray, motions: FloatArray) -> FloatArray:
    """Return e^2 (..., M) of the matches under motions (..., 4)."""
    scale = motions[..., 3, np.newaxis, np.newaxis]
    moved = se2.transform_points(motions[..., np.newaxis, :3], scale * points_b)
    return np.asarray(((moved - points_a) ** 2).sum(axis=-1))


def _costs(points_a: FloatArray, points_b: FloatArray, motions: FloatArray, tolerance_m: float) -> FloatArray:
    """Return the MSAC cost (H,), (3.12) with (3.14), of motions (H, 4)."""
    errors = _squared_errors(points_a, points_b, motions)
    return np.asarray(np.minimum(errors, tolerance_m**2).sum(axis=-1))


def _refit(
    points_a: FloatArray, points_b: FloatArray, motion: FloatArray, tolerance_m: float, free_scale: bool
) -> Consensus:
    """Fit all inliers by least squares, which may change who they are, a few times."""
    inliers = _squared_errors(points_a, points_b, motion) < tolerance_m**2
    for _ in range(_REFITS):
        if np.count_nonzero(inliers) < 2:
            break
        fitted = _fitted(points_a[inliers], points_b[inliers], free_scale)
        closer = _squared_errors(points_a, points_b, fitted) < tolerance_m**2
        if np.count_nonzero(closer) < np.count_nonzero(inliers):
            break
        motion, inliers = fitted, closer
    return Consensus(motion[:3], inliers, float(motion[3]))


def _fitted(points_a: FloatArray, points_b: FloatArray, free_scale: bool) -> FloatArray:
    """Return the motion (4,) of the least sum of squares over matched points (N, 2); its turn is the rigid one's."""
    rigid = align_points(points_a, points_b)
    if not free_scale:
        return np.array([*rigid, 1.0])
    turn = np.array([0.0, 0.0, rigid[2]])
    middle_a, middle_b = points_a.mean(axis=0), points_b.mean(axis=0)
    around_a, around_b = points_a - middle_a, se2.transform_points(turn, points_b - middle_b)
    scale = float((around_a * around_b).sum() / (around_b**2).sum())
    return np.array([*(middle_a - scale * se2.transform_points(turn, middle_b[np.newaxis])[0]), rigid[2], scale])
