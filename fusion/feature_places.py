"""Places by features: AKAZE matches of the free space of two maps, and the motions that many of them agree on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.consensus import find_consensus
from fusion.features import FeatureMethod, detect_features
from fusion.free_space import Layer, rescale
from fusion.matching import match_descriptors
from fusion.survey import SurveyedMap
from mapping import se2
from mapping.wall_map import FREE

FloatArray = NDArray[np.float64]
_CELL_M = 0.1
_RATIO = 0.81  # of squared distances: Hamming distances of bits are such, so this is stricter than 0.9 of distances
_TOLERANCE_M, _TRIALS, _CONFIDENCE, _PLACES, _LEAST = 0.15, 3000, 0.999, 6, 4
_AGREES_M = 0.3
_MOST = 3000


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Matched keypoints (M, 2) of both maps, in m in the grids' own frames."""

    points_a: FloatArray
    points_b: FloatArray


def match_maps(a: SurveyedMap, b: SurveyedMap) -> Matches:
    """Match keypoints of both maps' free space at one cell size."""
    cell_m = max(_CELL_M, a.walls.resolution_m, b.walls.resolution_m)
    found = [detect_features(_free_image(each, cell_m), FeatureMethod("akaze")) for each in (a, b)]
    in_a, in_b = match_descriptors(found[0].descriptors[:_MOST], found[1].descriptors[:_MOST], _RATIO)
    return Matches(found[0].points[in_a] * cell_m, found[1].points[in_b] * cell_m)


def feature_places(matches: Matches, seed: int) -> FloatArray:
    """Return poses (K, 3) of grid b in grid a's frame: the one most matches agree on, then most of the others, ..."""
    left = np.ones(len(matches.points_a), np.bool_)
    places: list[FloatArray] = []
    while len(places) < _PLACES:
        consensus = find_consensus(
            matches.points_a[left], matches.points_b[left], _TOLERANCE_M,
            trials=_TRIALS, confidence=_CONFIDENCE, seed=seed + len(places),
        )  # fmt: skip
        if consensus is None or np.count_nonzero(consensus.inliers) < _LEAST:
            break
        places.append(consensus.T_a_b)
        left[np.flatnonzero(left)[consensus.inliers]] = False
    return np.array(places).reshape(-1, 3)


def agreeing_matches(matches: Matches, poses: FloatArray) -> FloatArray:
    """Return how many matches agree with each of poses (K, 3)."""
    moved = se2.transform_points(poses[:, np.newaxis, :], matches.points_b)
    apart = np.hypot(*(moved - matches.points_a).transpose(2, 0, 1))
    return np.asarray((apart <= _AGREES_M).sum(axis=1), dtype=np.float64)


def _free_image(surveyed: SurveyedMap, cell_m: float) -> Layer:
    free = np.where(surveyed.walls.states == FREE, np.uint8(255), np.uint8(0))
    return rescale(free, surveyed.walls.resolution_m, cell_m)
