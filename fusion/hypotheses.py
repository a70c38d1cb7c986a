"""Where could one map lie on the other? Many places, from a search without correspondences and from features."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.feature_places import Matches, agreeing_matches, feature_places
from fusion.survey import SurveyedMap
from mapping import se2
from mapping.layer_correlation import coarse_layers, correlate
from mapping.map_agreement import net_metres
from mapping.map_matching import refine_each

FloatArray = NDArray[np.float64]
_ROUGH_SCALES_M = (0.5, 0.5, 0.4, 0.4, 0.35, 0.3, 0.3, 0.25, 0.25, 0.25)
_FINE_SCALES_M = tuple(0.4 * 0.25 ** (step / 19.0) for step in range(20))
_RAW_APART_M, _RAW_APART_RAD = 1.0, np.radians(6.0)  # places of the search that are told apart
_APART_M, _APART_RAD = 0.5, np.radians(4.0)  # and after a rough refinement
_SAME_M, _SAME_RAD = 0.4, np.radians(3.0)  # refined places that are one


@dataclass(frozen=True, slots=True)
class SearchScale:
    """The search's cell is so large that the maps span about `cells` of them; peaks_per_turn: places a rotation."""

    cells: int
    peaks_per_turn: int


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """How thoroughly to look.

    scales: of the search, the coarsest first. Coarse cells find bent maps, fine ones small overlaps. cell_m: the least.
    turns: rotations, an even number. The best `raw` places are refined roughly and the best `kept` of those fully.
    """

    scales: tuple[SearchScale, ...] = (SearchScale(200, 4), SearchScale(420, 8))
    cell_m: float = 0.1
    turns: int = 120
    raw: int = 400
    kept: int = 56


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """Refined poses (K, 3) of grid b in grid a's frame, and how many feature matches agree with each (K,)."""

    poses: FloatArray
    matches: FloatArray


def find_hypotheses(
    a: SurveyedMap, b: SurveyedMap, matches: Matches, settings: SearchSettings | None = None, *, seed: int
) -> Pool:
    """Return refined places of map b on map a, which both have walls and free space; matches are of `match_maps`."""
    rule = settings or SearchSettings()
    middle = np.array([*b.rough.points.mean(axis=0), 0.0])
    found = _distinct(_search(a, b, rule), middle, rule.raw)
    centred = se2.compose(np.vstack([feature_places(matches, seed), found]), middle)
    refined = refine_each(a.walls, b.rough.points - middle[:2], centred, _ROUGH_SCALES_M)
    promising = _promising(a, b, np.vstack([centred, refined]), middle, matches, rule.kept)
    fine = refine_each(a.walls, b.probe.points - middle[:2], promising, _FINE_SCALES_M)
    fine[:, 2] = se2.wrap_angle(fine[:, 2])
    kept = _apart(fine, np.arange(len(fine)), len(fine), len(fine), _SAME_M, _SAME_RAD)
    poses = se2.compose(fine[kept], se2.inverse(middle))
    return Pool(poses, agreeing_matches(matches, poses))


def _search(a: SurveyedMap, b: SurveyedMap, settings: SearchSettings) -> FloatArray:
    """Correlate the layers of both maps at each scale; return the poses (K, 3), in turn the best of each."""
    extent_m = max(a.walls.states.shape) * a.walls.resolution_m + float(
        np.hypot(*b.walls.states.shape) * b.walls.resolution_m
    )
    least_m = max(settings.cell_m, a.walls.resolution_m, b.walls.resolution_m)
    # Small maps span few of the least cells: there scales fall together, and the one with most peaks is kept.
    peaks = {max(least_m, extent_m / scale.cells): scale.peaks_per_turn for scale in settings.scales}
    found = [
        correlate(
            coarse_layers(a.walls, cell_m), coarse_layers(b.walls, cell_m), turns=settings.turns, peaks_per_turn=count
        ).poses
        for cell_m, count in peaks.items()
    ]
    rank = np.concatenate([np.arange(len(poses)) for poses in found])
    return np.asarray(np.vstack(found)[np.argsort(rank, kind="stable")])


def _distinct(poses: FloatArray, middle: FloatArray, most: int) -> FloatArray:
    """Return the first of poses (K, 3) without those that are one place at map b's middle."""
    centres = se2.compose(poses, middle)
    return poses[_apart(centres, np.arange(len(centres)), 1, most, _RAW_APART_M, _RAW_APART_RAD)]


def _promising(
    a: SurveyedMap, b: SurveyedMap, centred: FloatArray, middle: FloatArray, matches: Matches, most: int
) -> FloatArray:
    """Return the best of roughly refined places by several measures in turn: no single one is best everywhere."""
    poses = se2.compose(centred, se2.inverse(middle))
    net = net_metres(a.surface, b.rough, poses, max(a.walls.resolution_m, b.walls.resolution_m))
    measures = (net[:, 1], net[:, 0], net[:, 2], -np.arange(len(poses)), agreeing_matches(matches, poses))
    in_turn = np.column_stack([np.argsort(-measure, kind="stable") for measure in measures]).reshape(-1)
    return centred[_apart(centred, in_turn, len(measures), most, _APART_M, _APART_RAD)]


@njit(cache=True, nogil=True)
def _apart(
    poses: FloatArray, order: NDArray[np.int64], at_a_time: int, most: int, within_m: float, within_rad: float
) -> NDArray[np.int64]:
    """Return the numbers of poses (K, 3), taken in an order, that are not as good as one taken before.

    After each `at_a_time` of them it ends if there are `most`.
    """
    chosen = np.empty(len(order), np.int64)
    count = 0
    for place in range(len(order)):
        n = order[place]
        fresh = True
        for other in chosen[:count]:
            apart = math.hypot(poses[n, 0] - poses[other, 0], poses[n, 1] - poses[other, 1])
            turned = abs((poses[n, 2] - poses[other, 2] + math.pi) % (2.0 * math.pi) - math.pi)
            if apart <= within_m and turned <= within_rad:
                fresh = False
                break
        if fresh:
            chosen[count] = n
            count += 1
        if count >= most and (place + 1) % at_a_time == 0:
            break
    found: NDArray[np.int64] = chosen[:count].copy()
    return found
