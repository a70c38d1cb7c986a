"""Algorithm 3 of the thesis up to the verdict: features of the free space, their matches, MSAC, acceptance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.consensus import Consensus, find_consensus
from fusion.features import Features, detect_features
from fusion.free_space import free_layer, rescale
from fusion.identity import reference_rank
from fusion.matching import match_descriptors
from fusion.verification import AcceptanceRule, compare, objection
from mapping import se2
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Algorithm3Settings:
    """The stages' parameters.

    alpha: cells less free than this are dropped (section 3.1). max_ratio: of the ratio test, on SSD (3.11).
    tolerance_px: MSAC's tau (3.14) in cells of the coarser map. trials, confidence: of MSAC. rule: see verification.
    hypotheses: so many motions are judged, each from the matches that the ones before left over.
    """

    alpha: float
    max_ratio: float
    tolerance_px: float
    trials: int
    rule: AcceptanceRule
    confidence: float = 0.99
    hypotheses: int = 1


THESIS = Algorithm3Settings(0.99, 0.6, 1.5, 1000, AcceptanceRule(10, 0.95))
TOLERANT = Algorithm3Settings(0.5, 0.8, 3.0, 5000, AcceptanceRule(6, 0.90, 5.0, 0.20), hypotheses=6)


def register_by_features(
    a: OccupancyGrid, b: OccupancyGrid, settings: Algorithm3Settings = THESIS, seed: int = 0
) -> Alignment:
    """Find the pose of map b in the frame of map a; exchanging the two gives exactly the inverse.

    Maps that cannot be aligned at all are refused with a reason, as are poses that fail the verification.
    """
    if reference_rank(b) < reference_rank(a):
        return _register(b, a, settings, seed, ("second", "first")).inverse()
    return _register(a, b, settings, seed, ("first", "second"))


def _register(
    fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings, seed: int, names: tuple[str, str]
) -> Alignment:
    """Run the stages; names say which argument each map was."""
    cell_m = max(fixed.resolution_m, moving.resolution_m)
    features, points = [], []
    for grid, name in ((fixed, names[0]), (moving, names[1])):
        layer = free_layer(grid, settings.alpha)
        if not layer.any():
            return Alignment(None, False, f"the {name} map has no cell that is free with p >= {settings.alpha:g}")
        found = detect_features(rescale(layer, grid.resolution_m, cell_m))
        features.append(found)
        points.append(_in_map_frame(found, grid, cell_m))
    in_fixed, in_moving = match_descriptors(features[0].descriptors, features[1].descriptors, settings.max_ratio)
    candidates = _candidates(points[0][in_fixed], points[1][in_moving], cell_m, settings, seed)
    if not candidates:
        counts = f"{len(points[0])} and {len(points[1])} keypoints, {len(in_fixed)} matches"
        return Alignment(None, False, f"no motion fits two matches ({counts})")
    judged = [_judge(fixed, moving, candidate, len(in_fixed), settings.rule) for candidate in candidates]
    return next((alignment for alignment in judged if alignment.accepted), judged[0])


def _candidates(
    points_a: FloatArray, points_b: FloatArray, cell_m: float, settings: Algorithm3Settings, seed: int
) -> list[Consensus]:
    """Return the motion that most matches agree on, then the one that most of the others agree on, and so on."""
    found: list[Consensus] = []
    left = np.ones(len(points_a), np.bool_)
    while len(found) < settings.hypotheses:
        consensus = find_consensus(
            points_a[left],
            points_b[left],
            settings.tolerance_px * cell_m,
            trials=settings.trials,
            confidence=settings.confidence,
            seed=seed + len(found),
        )
        if consensus is None or (found and np.count_nonzero(consensus.inliers) < settings.rule.min_inliers):
            break
        found.append(consensus)
        left[np.flatnonzero(left)[consensus.inliers]] = False
    return found


def _judge(
    fixed: OccupancyGrid, moving: OccupancyGrid, candidate: Consensus, matches: int, rule: AcceptanceRule
) -> Alignment:
    """Compare the maps at a candidate's motion."""
    inliers = int(np.count_nonzero(candidate.inliers))
    agreement = compare(fixed, moving, candidate.T_a_b)
    against = objection(agreement, inliers, rule)
    reason = against or (
        f"{inliers} of {matches} matches agree, acceptance index {agreement.acceptance:.3f}, "
        f"{agreement.wall_m:.0f} m of common wall"
    )
    return Alignment(candidate.T_a_b, against is None, reason, inliers, agreement.acceptance, agreement.overlap)


def _in_map_frame(features: Features, grid: OccupancyGrid, cell_m: float) -> FloatArray:
    """Return the keypoints (N, 2) in metres in the map's frame."""
    return se2.transform_points(grid.origin, features.points * cell_m)
