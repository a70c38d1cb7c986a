"""Where could one map lie on the other? Many places, from a search without correspondences and from features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.feature_places import Matches, agreeing_matches, feature_places
from fusion.survey import SurveyedMap
from mapping import se2
from mapping.layer_correlation import Shifts, coarse_layers, correlate
from mapping.map_agreement import net_metres
from mapping.map_matching import refine_each

FloatArray = NDArray[np.float64]
_ROUGH_SCALES_M = (0.5, 0.5, 0.4, 0.4, 0.35, 0.3, 0.3, 0.25, 0.25, 0.25)
_FINE_SCALES_M = tuple(0.4 * 0.25 ** (step / 19.0) for step in range(20))
_RAW_APART_M, _RAW_APART_RAD = 1.0, np.radians(6.0)  # places of the search that are told apart
_APART_M, _APART_RAD = 0.5, np.radians(4.0)  # and after a rough refinement
_SAME_M, _SAME_RAD = 0.4, np.radians(3.0)  # refined places that are one


@dataclass(frozen=True, slots=True)
class SearchSettings:
    """How thoroughly to look.

    The search's cell is at least cell_m, and so large that the maps span about `cells` of them. Of peaks_per_turn
    places in each of `turns` rotations the best `raw` are refined roughly and the best `kept` of those fully.
    common_free: weight of common free space beside common wall; large wholes need much of it, small overlaps little.
    """

    cell_m: float = 0.1
    cells: int = 320
    turns: int = 120
    peaks_per_turn: int = 3
    raw: int = 200
    kept: int = 48
    common_free: float = 0.05


FAST = SearchSettings()
DEEP = SearchSettings(cells=640, peaks_per_turn=6, raw=700, kept=64, common_free=0.02)


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """Refined poses (K, 3) of grid b in grid a's frame, and how many feature matches agree with each (K,)."""

    poses: FloatArray
    matches: FloatArray


def find_hypotheses(
    a: SurveyedMap,
    b: SurveyedMap,
    matches: Matches,
    settings: SearchSettings,
    *,
    seed: int,
    earlier: Pool | None = None,
) -> Pool:
    """Return refined places of map b on map a, those of an earlier pool among them.

    Both maps must have walls and free space; matches are those of `match_maps`, the same for every search.
    """
    middle = np.array([*b.rough.points.mean(axis=0), 0.0])
    shifts = _search(a, b, settings)
    raw = [feature_places(matches, seed), _distinct(shifts, middle, settings.raw)]
    if earlier is not None:
        raw.insert(0, earlier.poses)
    centred = se2.compose(np.vstack(raw), middle)
    refined = refine_each(a.walls, b.rough.points - middle[:2], centred, _ROUGH_SCALES_M)
    promising = _promising(a, b, np.vstack([centred, refined]), middle, matches, settings.kept)
    fine = refine_each(a.walls, b.probe.points - middle[:2], promising, _FINE_SCALES_M)
    fine[:, 2] = se2.wrap_angle(fine[:, 2])
    kept: list[int] = []
    for n in range(len(fine)):
        if not _is_near(fine[n], fine[kept], _SAME_M, _SAME_RAD):
            kept.append(n)
    poses = se2.compose(fine[kept], se2.inverse(middle))
    return Pool(poses, agreeing_matches(matches, poses))


def _search(a: SurveyedMap, b: SurveyedMap, settings: SearchSettings) -> Shifts:
    """Correlate the layers of both maps."""
    extent_m = max(a.walls.states.shape) * a.walls.resolution_m + float(
        np.hypot(*b.walls.states.shape) * b.walls.resolution_m
    )
    cell_m = max(settings.cell_m, a.walls.resolution_m, b.walls.resolution_m, extent_m / settings.cells)
    layers = coarse_layers(a.walls, cell_m), coarse_layers(b.walls, cell_m)
    return correlate(
        *layers,
        turns=settings.turns,
        peaks_per_turn=settings.peaks_per_turn,
        common_free=settings.common_free,
    )


def _distinct(shifts: Shifts, middle: FloatArray, most: int) -> FloatArray:
    """Return the best shifts without those that are one place at map b's middle."""
    centres = se2.compose(shifts.poses, middle)
    chosen: list[int] = []
    for n in range(len(centres)):
        if not _is_near(centres[n], centres[chosen], _RAW_APART_M, _RAW_APART_RAD):
            chosen.append(n)
            if len(chosen) == most:
                break
    return shifts.poses[chosen]


def _promising(
    a: SurveyedMap, b: SurveyedMap, centred: FloatArray, middle: FloatArray, matches: Matches, most: int
) -> FloatArray:
    """Return the best of roughly refined places by several measures in turn: no single one is best everywhere."""
    poses = se2.compose(centred, se2.inverse(middle))
    net = net_metres(a.surface, b.rough, poses, max(a.walls.resolution_m, b.walls.resolution_m))
    measures = (net[:, 1], net[:, 0], net[:, 2], -np.arange(len(poses)), agreeing_matches(matches, poses))
    orders = [np.argsort(-measure, kind="stable") for measure in measures]
    chosen: list[int] = []
    for ranked in zip(*orders, strict=True):
        for n in map(int, ranked):
            if n not in chosen and not _is_near(centred[n], centred[chosen], _APART_M, _APART_RAD):
                chosen.append(n)
        if len(chosen) >= most:
            break
    return centred[chosen]


def _is_near(pose: FloatArray, others: FloatArray, within_m: float, within_rad: float) -> bool:
    """Whether one of other poses (K, 3) is as good as the same."""
    near = (np.abs(others[:, :2] - pose[:2]) <= within_m).all(axis=1)
    if not near.any():
        return False
    close = others[near]
    apart = np.hypot(close[:, 0] - pose[0], close[:, 1] - pose[1])
    turned = np.abs((close[:, 2] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi)
    return bool(((apart <= within_m) & (turned <= within_rad)).any())
