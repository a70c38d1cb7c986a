"""Stage 4 of Algorithm 3: the rigid motion that most matches agree on, by MSAC (thesis section 3.5, Algorithm 2)."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Consensus:
    """T_a_b (3,) and which of the matches (M,) are inliers."""

    T_a_b: FloatArray
    inliers: NDArray[np.bool_]


def find_consensus(
    points_a: FloatArray, points_b: FloatArray, tolerance_m: float, *, trials: int, confidence: float, seed: int
) -> Consensus | None:
    """Return the rigid motion with the lowest MSAC cost over matched points (M, 2) in m; None without any.

    The cost is (3.12) with (3.14), whose lines both compare e^2 with tolerance^2 (the thesis's first line lacks the
    square). Trials end early once `confidence` is reached that a sample without outliers was among them.
    """
    if len(points_a) < 2:
        return None
    random = np.random.default_rng(seed)
    best, best_cost, done, needed = None, math.inf, 0, float(trials)
    while done < min(trials, needed):
        motions = _hypotheses(points_a, points_b, tolerance_m, random, min(_BATCH, trials - done))
        done += _BATCH
        if len(motions) == 0:
            continue
        costs = _costs(points_a, points_b, motions, tolerance_m)
        lowest = int(np.argmin(costs))
        if costs[lowest] < best_cost:
            best, best_cost = motions[lowest], float(costs[lowest])
            share = np.count_nonzero(_squared_errors(points_a, points_b, best) < tolerance_m**2) / len(points_a)
            needed = math.log(1.0 - confidence) / math.log1p(-min(share**2, 1.0 - 1e-12)) if share else math.inf
    return None if best is None else _refit(points_a, points_b, best, tolerance_m)


def _hypotheses(
    points_a: FloatArray, points_b: FloatArray, tolerance_m: float, random: np.random.Generator, count: int
) -> FloatArray:
    """Return rigid motions (H, 3), H <= count, through two matches each, whose distances agree within tolerances."""
    first = random.integers(0, len(points_a), count)
    second = (first + random.integers(1, len(points_a), count)) % len(points_a)
    side_a, side_b = points_a[second] - points_a[first], points_b[second] - points_b[first]
    length_a, length_b = np.hypot(*side_a.T), np.hypot(*side_b.T)
    fits = (np.abs(length_a - length_b) <= 2.0 * tolerance_m) & (length_a > tolerance_m) & (length_b > tolerance_m)
    first, second, side_a, side_b = first[fits], second[fits], side_a[fits], side_b[fits]
    turn = np.arctan2(side_a[:, 1], side_a[:, 0]) - np.arctan2(side_b[:, 1], side_b[:, 0])
    turns = np.column_stack([np.zeros((len(turn), 2)), turn])
    middle_a, middle_b = (points_a[first] + points_a[second]) / 2.0, (points_b[first] + points_b[second]) / 2.0
    return np.column_stack([middle_a - se2.transform_points(turns, middle_b), se2.wrap_angle(turn)])


def _squared_errors(points_a: FloatArray, points_b: FloatArray, motions: FloatArray) -> FloatArray:
    """Return e^2 (..., M) of the matches under motions (..., 3)."""
    moved = se2.transform_points(motions[..., np.newaxis, :], points_b)
    return np.asarray(((moved - points_a) ** 2).sum(axis=-1))


def _costs(points_a: FloatArray, points_b: FloatArray, motions: FloatArray, tolerance_m: float) -> FloatArray:
    """Return the MSAC cost (H,), (3.12) with (3.14), of motions (H, 3)."""
    errors = _squared_errors(points_a, points_b, motions)
    return np.asarray(np.minimum(errors, tolerance_m**2).sum(axis=-1))


def _refit(points_a: FloatArray, points_b: FloatArray, motion: FloatArray, tolerance_m: float) -> Consensus:
    """Fit all inliers by least squares, which may change who they are, a few times."""
    inliers = _squared_errors(points_a, points_b, motion) < tolerance_m**2
    for _ in range(_REFITS):
        fitted = align_points(points_a[inliers], points_b[inliers])
        closer = _squared_errors(points_a, points_b, fitted) < tolerance_m**2
        if np.count_nonzero(closer) < np.count_nonzero(inliers):
            break
        motion, inliers = fitted, closer
    return Consensus(motion, inliers)
