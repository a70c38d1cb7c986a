"""`evaluate features`: what detectors and descriptors find on two maps, by alpha (thesis table 4.2, fig. 3.5b)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.algorithm3 import Algorithm3Settings, match_maps, propose_motions, tolerance_m
from fusion.features import FeatureMethod
from fusion.verification import compare
from mapping.grid import OccupancyGrid


@dataclass(frozen=True, slots=True)
class FeatureTrial:
    """What one combination found on two maps.

    precision is inliers per match (4.1), None without matches; acceptance is omega (3.15), 0 without a motion; seconds
    the wall-clock time of detection, description, matching and MSAC (4.4).
    """

    features: str
    alpha: float
    keypoints_a: int
    keypoints_b: int
    matches: int
    inliers: int
    precision: float | None
    acceptance: float
    seconds: float


def study_features(
    a: OccupancyGrid,
    b: OccupancyGrid,
    settings: Algorithm3Settings,
    choices: tuple[Sequence[FeatureMethod], Sequence[float]],
    seed: int,
    on_progress: Callable[[str], None],
) -> list[FeatureTrial]:
    """Run stages 1 to 4 on map b against map a for every choice of features and of alpha, with one motion each."""
    trials = []
    for features in choices[0]:
        for alpha in choices[1]:
            on_progress(f"{features.name}, alpha {alpha:g}")
            trials.append(_trial(a, b, replace(settings, features=features, alpha=alpha, hypotheses=1), seed))
    return trials


def table_of(trials: Sequence[FeatureTrial]) -> list[str]:
    """Return the lines of a table with one row a trial."""
    lines = [
        f"{'features':18}{'alpha':>6}{'keypoints A, B':>17}{'matches':>9}{'inliers':>9}{'of them':>9}   omega       s"
    ]
    for trial in trials:
        share = "-" if trial.precision is None else f"{trial.precision:.0%}"
        lines.append(
            f"{trial.features:18}{trial.alpha:6g}{trial.keypoints_a:9d}{trial.keypoints_b:8d}{trial.matches:9d}"
            f"{trial.inliers:9d}{share:>9}{trial.acceptance:8.3f}{trial.seconds:8.2f}"
        )
    return lines


def _trial(a: OccupancyGrid, b: OccupancyGrid, settings: Algorithm3Settings, seed: int) -> FeatureTrial:
    started = time.perf_counter()
    matches = match_maps(a, b, settings)
    motions = propose_motions(matches, tolerance_m(a, b, settings), settings, seed)
    seconds = time.perf_counter() - started
    inliers = int(np.count_nonzero(motions[0].inliers)) if motions else 0
    count = len(matches.fixed)
    assert settings.alpha is not None
    return FeatureTrial(
        features=settings.features.name,
        alpha=settings.alpha,
        keypoints_a=matches.keypoints[0],
        keypoints_b=matches.keypoints[1],
        matches=count,
        inliers=inliers,
        precision=round(inliers / count, 4) if count else None,
        acceptance=round(compare(a, b, motions[0].T_a_b).acceptance, 4) if motions else 0.0,
        seconds=round(seconds, 3),
    )
