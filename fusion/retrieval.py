"""Which pairs of many maps are worth a registration: a cheap look at what their free space has in common.

A map's signature is its AKAZE keypoints, which no rotation changes; two maps resemble each other by how many keypoints
agree on one motion. That costs milliseconds where a registration costs a second, and ranks pairs; it refuses none for
good. Of up to eight maps all pairs are registered. Of more:

1. pairs of maps that resemble each other, and for each map those that resemble it most;
2. between each two groups that these make, the most similar pairs, so that maps of little texture are tried with others
   too, a lone map with many;
3. within a group all pairs that overlap at the poses found: they hold the group together, or show that it is wrong.

The pairs depend on the maps and on what these pairs' registrations say only, not on what else has been registered.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.consensus import find_consensus
from fusion.features import Descriptors, FeatureMethod, detect_features
from fusion.free_space import rescale
from fusion.matching import match_descriptors
from fusion.resampling import cut_to_known
from fusion.survey import FREE_BELOW
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
Pair = tuple[str, str]
_CELL_M, _STRONGEST, _RATIO = 0.1, 1000, 0.81
_TOLERANCE_M, _TRIALS, _CONFIDENCE = 0.2, 500, 0.99


@dataclass(frozen=True, slots=True)
class RetrievalRule:
    """How many pairs are registered.

    all_pairs: of so many maps all pairs are. alike: keypoints that agree on a motion from which two maps resemble each
    other. nearest: pairs of each map at the least. between: pairs of each two groups. most: of each map, on behalf of
    its group, in step 2.
    """

    all_pairs: int = 8
    alike: int = 3
    nearest: int = 4
    between: int = 4
    most: int = 24


@dataclass(frozen=True, slots=True, eq=False)
class MapSignature:
    """Keypoints (N, 2) of a map's free space in m, and their descriptors (N, K)."""

    points: FloatArray
    descriptors: Descriptors


@dataclass(frozen=True, slots=True, eq=False)
class MapsTogether:
    """The maps of a group, and the pairs of them that overlap at their poses."""

    keys: Sequence[str]
    overlapping: Sequence[Pair]


def signature(grid: OccupancyGrid) -> MapSignature:
    """Return a map's signature; it is empty where the free space has no texture."""
    cut = cut_to_known(grid)
    free = np.where(cut.log_odds < FREE_BELOW, np.uint8(255), np.uint8(0))
    cell_m = max(_CELL_M, cut.resolution_m)
    features = detect_features(rescale(free, cut.resolution_m, cell_m), FeatureMethod("akaze"))
    return MapSignature(features.points[:_STRONGEST] * cell_m, features.descriptors[:_STRONGEST])


def resemblance(a: MapSignature, b: MapSignature) -> float:
    """Return how many keypoints of two maps agree on one motion, plus a fraction by how many match at all."""
    if min(len(a.points), len(b.points)) < 2:
        return 0.0
    in_a, in_b = match_descriptors(a.descriptors, b.descriptors, _RATIO)
    if len(in_a) < 2:
        return 0.0
    consensus = find_consensus(
        a.points[in_a], b.points[in_b], _TOLERANCE_M, trials=_TRIALS, confidence=_CONFIDENCE, seed=0
    )
    agreeing = 0 if consensus is None else int(np.count_nonzero(consensus.inliers))
    return agreeing + len(in_a) / (len(in_a) + 1000.0)


def chosen_pairs(
    keys: Sequence[str],
    alike: Mapping[Pair, float],
    verdicts: Mapping[Pair, bool],
    grouped: Callable[[Iterable[Pair]], Iterable[MapsTogether]],
    rule: RetrievalRule | None = None,
) -> list[Pair]:
    """Return the pairs whose registrations count; of those without a verdict yet come more pairs, once they have one.

    keys: the maps, whose order is that of the maps in a pair. alike: the resemblance of every pair; not needed for as
    few maps as the rule names. verdicts: whether a registered pair was accepted. grouped: the groups that follow from
    accepted pairs.
    """
    rule = rule or RetrievalRule()
    everything = list(itertools.combinations(keys, 2))
    if len(keys) <= rule.all_pairs:
        return everything
    place = {pair: number for number, pair in enumerate(everything)}
    ranked = sorted(everything, key=lambda pair: (-alike[pair], place[pair]))
    chosen = {pair for pair in ranked if alike[pair] >= rule.alike} | _nearest(keys, ranked, rule.nearest)
    while all(pair in verdicts for pair in chosen):
        accepted = [pair for pair in sorted(chosen, key=place.__getitem__) if verdicts[pair]]
        groups = list(grouped(accepted))
        more = _between_groups(groups, ranked, rule) - chosen
        if not more:
            more = {pair for group in groups for pair in group.overlapping} - chosen
        if not more:
            break
        chosen |= more
    return sorted(chosen, key=place.__getitem__)


def _nearest(keys: Sequence[str], ranked: Sequence[Pair], count: int) -> set[Pair]:
    """Return the first pairs of each map, so many of each."""
    left = dict.fromkeys(keys, count)
    found = set()
    for pair in ranked:
        if max(left[pair[0]], left[pair[1]]) > 0:
            found.add(pair)
        for key in pair:
            left[key] -= 1
    return found


def _between_groups(groups: Sequence[MapsTogether], ranked: Sequence[Pair], rule: RetrievalRule) -> set[Pair]:
    """Return the first pairs between each two groups."""
    group_of = {key: number for number, group in enumerate(groups) for key in group.keys}
    between: dict[frozenset[int], int] = {}
    asked = dict.fromkeys(group_of, 0)
    found = set()
    for a, b in ranked:
        two = frozenset({group_of[a], group_of[b]})
        if len(two) < 2 or between.get(two, 0) >= rule.between or min(asked[a], asked[b]) >= rule.most:
            continue
        between[two] = between.get(two, 0) + 1
        asked[a] += 1
        asked[b] += 1
        found.add((a, b))
    return found
