"""Where could one map lie on the other? Many places, from a search without correspondences and from features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.feature_places import Matches, agreeing_matches, feature_places, match_maps
from fusion.survey import SurveyedMap
from mapping import se2
from mapping.layer_correlation import Shifts, coarse_layers, correlate
from mapping.map_agreement import Agreements, judge_poses
from mapping.map_matching import refine_each

FloatArray = NDArray[np.float64]
_ROUGH_SCALES_M = (0.5, 0.5, 0.4, 0.4, 0.35, 0.3, 0.3, 0.25, 0.25, 0.25)
_FINE_SCALES_M = tuple(0.4 * 0.25 ** (step / 19.0) for step in range(20))


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """cell_m, cells: the search's cell is at least cell_m, and so large that the maps span about `cells` of them."""

    cell_m: float = 0.1
    cells: int = 320
    turns: int = 120
    peaks_per_turn: int = 3
    raw: int = 200
    kept: int = 48


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """K refined poses (K, 3) of grid b in grid a's frame, and for each how often the search came to it.

    score (K,): best correlation, as a share of the best of all; votes (K,): raw places that ended there; matches (K,):
    feature matches that agree.
    """

    poses: FloatArray
    score: FloatArray
    votes: FloatArray
    matches: FloatArray


def find_hypotheses(a: SurveyedMap, b: SurveyedMap, settings: SearchSettings, seed: int = 0) -> Pool:
    """Return the refined places of map b on map a, most promising first."""
    extent = max(a.walls.states.shape) * a.walls.resolution_m + np.hypot(*b.walls.states.shape) * b.walls.resolution_m
    cell_m = max(settings.cell_m, a.walls.resolution_m, b.walls.resolution_m, extent / settings.cells)
    shifts = correlate(
        coarse_layers(a.walls, cell_m),
        coarse_layers(b.walls, cell_m),
        turns=settings.turns,
        peaks_per_turn=settings.peaks_per_turn,
    )
    middle = np.array([*b.rough.points.mean(axis=0), 0.0])
    poses, scores = _distinct(shifts, middle, settings.raw, 1.0, np.radians(6.0))
    centred = se2.compose(poses, middle)
    matches = match_maps(a, b)
    by_features = se2.compose(feature_places(matches, seed), middle)
    centred = np.vstack([by_features, centred])
    scores = np.concatenate([np.zeros(len(by_features)), scores])
    refined = np.vstack([centred, refine_each(a.walls, b.rough.points - middle[:2], centred, _ROUGH_SCALES_M)])
    least_cell_m = max(a.walls.resolution_m, b.walls.resolution_m)
    found = judge_poses(a.surface, b.rough, se2.compose(refined, se2.inverse(middle)), least_cell_m)
    return _pool(a, b, refined, np.concatenate([scores, scores]), found, middle, settings, matches)


def _pool(
    a: SurveyedMap,
    b: SurveyedMap,
    centred: FloatArray,
    scores: FloatArray,
    found: Agreements,
    middle: FloatArray,
    settings: SearchSettings,
    matches: Matches,
) -> Pool:
    """Refine the most promising places fully."""
    merit = found.hits[:, 1] - 2.0 * found.conflicts[:, 1]
    strict = found.hits[:, 0] - 2.0 * found.conflicts[:, 0]
    free = found.hits[:, 2] - 2.0 * found.conflicts[:, 2]
    chosen: list[int] = []
    agreeing = agreeing_matches(matches, se2.compose(centred, se2.inverse(middle)))
    orders = [np.argsort(-value, kind="stable") for value in (merit, strict, free, scores, agreeing)]
    for rank in range(len(centred)):
        for order in orders:
            n = int(order[rank])
            if n not in chosen and not _is_near(centred[n], centred[chosen], 0.5, np.radians(4.0)):
                chosen.append(n)
        if len(chosen) >= settings.kept:
            break
    fine = refine_each(a.walls, b.probe.points - middle[:2], centred[chosen], _FINE_SCALES_M)
    fine[:, 2] = se2.wrap_angle(fine[:, 2])
    kept: list[int] = []
    votes = np.ones(len(fine))
    for n in range(len(fine)):
        near = [k for k in kept if _is_near(fine[n], fine[[k]], 0.4, np.radians(3.0))]
        if near:
            votes[near[0]] += 1.0
        else:
            kept.append(n)
    poses = se2.compose(fine[kept], se2.inverse(middle))
    share = scores[np.array(chosen)[kept]] / max(float(scores.max()), 1e-9)
    return Pool(poses, share, votes[kept], agreeing_matches(matches, poses))


def _is_near(pose: FloatArray, others: FloatArray, within_m: float, within_rad: float) -> bool:
    apart = np.hypot(*(others[:, :2] - pose[:2]).T)
    turned = np.abs(se2.wrap_angle(others[:, 2] - pose[2]))
    return bool(((apart <= within_m) & (turned <= within_rad)).any())


def _distinct(
    shifts: Shifts, middle: FloatArray, most: int, apart_m: float, apart_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Return the best shifts without those that are one place at map b's middle."""
    centres = se2.compose(shifts.poses, middle)
    chosen: list[int] = []
    for n in range(len(centres)):
        if not _is_near(centres[n], centres[chosen], apart_m, apart_rad):
            chosen.append(n)
            if len(chosen) == most:
                break
    return shifts.poses[chosen], shifts.scores[chosen]
