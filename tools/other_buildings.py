"""Pairs of maps of different buildings, which have no right pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapping.map_yaml import read_map_yaml
from tools.pair_files import MapPair

FIRST, FINISHED = "first", "finished"
_COARSER = 1.5
_TRIES_A_PAIR = 50


@dataclass(frozen=True, slots=True, eq=False)
class BuildingMap:
    """A map of a building: kind is that of the pairs in which it is the second map, else FIRST or FINISHED."""

    building: str
    path: Path
    kind: str
    resolution_m: float


def maps_of_pairs(pairs: Sequence[MapPair]) -> list[BuildingMap]:
    """Return the maps of pairs, each once: the first of a pair as FIRST, the second as the pair's kind."""
    found: dict[Path, BuildingMap] = {}
    for pair in pairs:
        for building, path, kind in ((pair.building_a, pair.a, FIRST), (pair.building_b, pair.b, pair.kind)):
            if path not in found:
                found[path] = BuildingMap(building, path, kind, read_map_yaml(path).resolution_m)
    return list(found.values())


def varied_pairs(
    first: Sequence[BuildingMap],
    second: Sequence[BuildingMap],
    count: int,
    random: np.random.Generator,
    taken: set[frozenset[Path]],
) -> Iterator[MapPair]:
    """Yield pairs of different buildings, every two buildings in turn, with random maps of each; none twice.

    taken holds the pairs that there are already, and grows.
    """
    buildings = sorted({(a.building, b.building) for a in first for b in second if a.building != b.building})
    order = [buildings[index] for index in random.permutation(len(buildings))]
    found = tried = 0
    while found < count and order and tried < _TRIES_A_PAIR * count:
        building_a, building_b = order[tried % len(order)]
        tried += 1
        candidates_a = [each for each in first if each.building == building_a]
        candidates_b = [each for each in second if each.building == building_b]
        a, b = (chosen[int(random.integers(len(chosen)))] for chosen in (candidates_a, candidates_b))
        if frozenset((a.path, b.path)) in taken:
            continue
        taken.add(frozenset((a.path, b.path)))
        found += 1
        yield MapPair(f"{a.path.stem}-{b.path.stem}", a.path, b.path, building_a, building_b, _kind(a, b))


def _kind(a: BuildingMap, b: BuildingMap) -> str:
    for kind in ("warped", "camera"):
        if kind in {a.kind, b.kind}:
            return kind
    ratio = max(a.resolution_m, b.resolution_m) / min(a.resolution_m, b.resolution_m)
    return "resolution" if ratio > _COARSER else "lidar"
