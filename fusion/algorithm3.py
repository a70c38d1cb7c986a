"""Algorithm 3 of the thesis up to the verdict: features of the free space, their matches, MSAC, acceptance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.consensus import Consensus, find_consensus
from fusion.errors import FusionError
from fusion.features import KAZE_SIFT, FeatureMethod, detect_features
from fusion.free_space import UNKNOWN, free_layer, rescale
from fusion.identity import precedes
from fusion.matching import match_descriptors
from fusion.verification import AcceptanceRule, compare, objection
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.metrics import align_points

FloatArray = NDArray[np.float64]
ALPHAS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)  # tried where alpha is to be chosen
_MAX_SCALE_ERROR = 0.05  # of the ratio of the resolutions


@dataclass(frozen=True, slots=True)
class Algorithm3Settings:
    """The stages' parameters; raises FusionError for values that no stage can use.

    alpha: cells less free than this are dropped (section 3.1); 0 takes the map as it is (fig. 3.5b), None the one of
    ALPHAS with the highest acceptance index. max_ratio: of the ratio test, on SSD (3.11). tolerance_px: MSAC's tau
    (3.14) in common cells. trials, confidence: of MSAC. rule: see verification. hypotheses: so many motions are judged,
    each from the matches that the ones before left over. scale: known from the resolutions, or estimated (section
    4.1.3.1) and held against them. common_cell: the cell that both layers are brought to (section 5.3).
    """

    alpha: float | None
    max_ratio: float
    tolerance_px: float
    trials: int
    rule: AcceptanceRule
    confidence: float = 0.99
    hypotheses: int = 1
    features: FeatureMethod = KAZE_SIFT
    scale: Literal["known", "estimate"] = "known"
    common_cell: Literal["coarse", "fine"] = "coarse"

    def __post_init__(self) -> None:
        if self.alpha is not None and not (self.alpha == 0.0 or 0.01 <= self.alpha <= 0.99):
            raise FusionError(f"alpha {self.alpha:g}: must be 0.01 to 0.99, or 0 for the map as it is (section 3.1)")
        for name, value, most in (
            ("ratio", self.max_ratio, 1.0),
            ("tolerance", self.tolerance_px, 100.0),
            ("trials", self.trials, 1e6),
            ("confidence", self.confidence, 1.0 - 1e-9),
        ):
            if not 0.0 < value <= most:
                raise FusionError(f"{name} {value:g}: must be above 0 and at most {most:g}")


THESIS = Algorithm3Settings(0.99, 0.6, 1.5, 1000, AcceptanceRule(10, 0.95))
TOLERANT = Algorithm3Settings(0.5, 0.8, 3.0, 5000, AcceptanceRule(6, 0.90, 5.0, 0.20), hypotheses=6)


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """How many keypoints each map has, and the putative matches: points (M, 2) in m in each map's frame."""

    keypoints: tuple[int, int]
    fixed: FloatArray
    moving: FloatArray


def register_by_features(
    a: OccupancyGrid, b: OccupancyGrid, settings: Algorithm3Settings = THESIS, seed: int = 0
) -> Alignment:
    """Find the pose of map b in the frame of map a; exchanging the two gives exactly the inverse.

    Maps that cannot be aligned at all are refused with a reason, as are poses that fail the verification.
    """
    register = _register_at_best_alpha if settings.alpha is None else _register
    if precedes(b, a):
        return register(b, a, settings, seed, ("second", "first")).inverse()
    return register(a, b, settings, seed, ("first", "second"))


def register_with_seeds(
    a: OccupancyGrid, b: OccupancyGrid, settings: Algorithm3Settings, seeds: Sequence[int]
) -> list[Alignment]:
    """Return what `register_by_features` finds with each seed: they differ in MSAC alone, so matches are made once.

    Not for an alpha that is to be chosen: raises FusionError.
    """
    if settings.alpha is None:
        raise FusionError("alpha None: runs that differ in the seed need one alpha, from 0.01 to 0.99, or 0")
    if precedes(b, a):
        return [each.inverse() for each in _register_each(b, a, settings, seeds, ("second", "first"))]
    return _register_each(a, b, settings, seeds, ("first", "second"))


def match_maps(fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings) -> Matches:
    """Run stages 1 to 3 at the settings' alpha, which must be a number: layers, features, putative matches."""
    assert settings.alpha is not None
    features, points = [], []
    for grid in (fixed, moving):
        cell_m = _common_cell_m(fixed, moving, settings) if settings.scale == "known" else grid.resolution_m
        layer = rescale(free_layer(grid, settings.alpha), grid.resolution_m, cell_m)
        features.append(detect_features(layer, settings.features, UNKNOWN if settings.alpha == 0.0 else 0))
        points.append(se2.transform_points(grid.origin, features[-1].points * cell_m))
    in_fixed, in_moving = match_descriptors(features[0].descriptors, features[1].descriptors, settings.max_ratio)
    return Matches((len(points[0]), len(points[1])), points[0][in_fixed], points[1][in_moving])


def propose_motions(matches: Matches, tolerance_m: float, settings: Algorithm3Settings, seed: int) -> list[Consensus]:
    """Return the motion that most matches agree on, then the one that most of the others agree on, and so on.

    Each is rigid; a scale other than 1 is what its matches would rather have.
    """
    found: list[Consensus] = []
    left = np.ones(len(matches.fixed), np.bool_)
    while len(found) < settings.hypotheses:
        consensus = find_consensus(
            matches.fixed[left],
            matches.moving[left],
            tolerance_m,
            trials=settings.trials,
            confidence=settings.confidence,
            seed=seed + len(found),
            free_scale=settings.scale == "estimate",
        )
        if consensus is None or (found and np.count_nonzero(consensus.inliers) < settings.rule.min_inliers):
            break
        agreeing = np.flatnonzero(left)[consensus.inliers]
        if settings.scale == "estimate" and len(agreeing):
            rigid = align_points(matches.fixed[agreeing], matches.moving[agreeing])
            consensus = replace(consensus, T_a_b=rigid)
        found.append(consensus)
        left[agreeing] = False
    return found


def tolerance_m(fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings) -> float:
    """Return MSAC's tolerance in m for two maps."""
    return settings.tolerance_px * _common_cell_m(fixed, moving, settings)


def _common_cell_m(fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings) -> float:
    both = fixed.resolution_m, moving.resolution_m
    return max(both) if settings.common_cell == "coarse" else min(both)


def _register_at_best_alpha(
    fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings, seed: int, names: tuple[str, str]
) -> Alignment:
    """Try all ALPHAS and return the accepted pose, else the one with enough inliers, with the highest index (3.15).

    An alpha that leaves the layers of the one before is skipped: on trinary maps one is tried.
    """
    tried: dict[tuple[int, int], tuple[float, Alignment]] = {}
    for alpha in ALPHAS:
        cells = [int(np.count_nonzero(free_layer(grid, alpha))) for grid in (fixed, moving)]
        if (cells[0], cells[1]) not in tried:
            alignment = _register(fixed, moving, replace(settings, alpha=alpha), seed, names)
            tried[cells[0], cells[1]] = alpha, alignment

    def rank(attempt: tuple[float, Alignment]) -> tuple[bool, bool, float, int]:
        inliers = attempt[1].inliers or 0
        return attempt[1].accepted, inliers >= settings.rule.min_inliers, attempt[1].acceptance, inliers

    alpha, best = max(tried.values(), key=rank)
    return replace(best, reason=f"{best.reason} (alpha {alpha:g}, chosen from {ALPHAS[0]:g} to {ALPHAS[-1]:g})")


def _register(
    fixed: OccupancyGrid, moving: OccupancyGrid, settings: Algorithm3Settings, seed: int, names: tuple[str, str]
) -> Alignment:
    return _register_each(fixed, moving, settings, (seed,), names)[0]


def _register_each(
    fixed: OccupancyGrid,
    moving: OccupancyGrid,
    settings: Algorithm3Settings,
    seeds: Sequence[int],
    names: tuple[str, str],
) -> list[Alignment]:
    """Run the stages at one alpha, MSAC and what follows with each seed; names say which argument each map was."""
    assert settings.alpha is not None
    for grid, name in ((fixed, names[0]), (moving, names[1])):
        if not free_layer(grid, settings.alpha).any() or not grid.known.any():
            return [Alignment(None, False, _nothing_free(grid, name, settings.alpha))] * len(seeds)
    matches = match_maps(fixed, moving, settings)
    return [_register_matches(fixed, moving, matches, settings, seed) for seed in seeds]


def _register_matches(
    fixed: OccupancyGrid, moving: OccupancyGrid, matches: Matches, settings: Algorithm3Settings, seed: int
) -> Alignment:
    """Return the first motion that is accepted, else the one that most matches agree on."""
    motions = propose_motions(matches, tolerance_m(fixed, moving, settings), settings, seed)
    if not motions:
        counts = f"{matches.keypoints[0]} and {matches.keypoints[1]} keypoints, {len(matches.fixed)} matches"
        return Alignment(None, False, f"no motion fits two matches ({counts})")
    judged = [_judge(fixed, moving, motion, len(matches.fixed), settings) for motion in motions]
    return next((alignment for alignment in judged if alignment.accepted), judged[0])


def _nothing_free(grid: OccupancyGrid, name: str, alpha: float) -> str:
    """Say that alpha leaves nothing of a map, and how free its cells are."""
    text = f"the {name} map has no cell that is free with p >= {alpha:g}"
    highest = float((1.0 - grid.probability[grid.known]).max(initial=0.0))
    return f"{text}: its freest has {highest:.3f}, a lower alpha is needed" if highest > 0.5 else text


def _judge(
    fixed: OccupancyGrid, moving: OccupancyGrid, motion: Consensus, matches: int, settings: Algorithm3Settings
) -> Alignment:
    """Compare the maps at a motion, and the scale that its matches want with the resolutions."""
    inliers = int(np.count_nonzero(motion.inliers))
    agreement = compare(fixed, moving, motion.T_a_b)
    known = moving.resolution_m / fixed.resolution_m
    scale = motion.scale * known if settings.scale == "estimate" else None
    against = objection(agreement, inliers, settings.rule)
    off = abs(motion.scale - 1.0)
    if against is None and off > _MAX_SCALE_ERROR:
        against = (
            f"the matches agree on a scale that is {off:.1%} off the ratio of the resolutions, "
            f"and a metric map has no free scale: at most {_MAX_SCALE_ERROR:.0%} is believed"
        )
    reason = against or (
        f"{inliers} of {matches} matches agree, acceptance index {agreement.acceptance:.3f}, "
        f"{agreement.wall_m:.0f} m of common wall"
        + ("" if scale is None else f", scale {off:.2%} off the ratio of the resolutions")
    )
    return Alignment(
        motion.T_a_b, against is None, reason, inliers, agreement.acceptance, agreement.overlap, scale=scale
    )
