"""Merging in levels, as the thesis does (section 5.5, figure 5.6): in each level the best pairs of maps become one.

The best pairs are those with the most inliers, and of equal ones the highest acceptance index; no map is in two pairs
of one level. What was merged is a map of the next level. A merged map is always made of the original ones at their
poses, so that no cell is looked up twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.certainty import CertaintyGrid, Contribution, fuse
from fusion.identity import reference_rank
from mapping import se2
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
Pair = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class LevelMap:
    """A map of some level: the original maps in it at their poses, in the frame of the one with the most known area.

    grid: their fusion, an original one as it is. parts: the two maps of lower levels that it was made of, merged_by the
    registration that found their relative pose, and cells, the evidence of all; none for an original one. level: in
    which it came to be; 0 for an original one.
    """

    name: str
    contributions: Mapping[str, Contribution]
    grid: OccupancyGrid
    parts: tuple[LevelMap, LevelMap] | None = None
    cells: CertaintyGrid | None = None
    level: int = 0
    merged_by: Alignment | None = None

    def fused(self) -> CertaintyGrid:
        """Return the evidence of the original maps."""
        return self.cells or fuse(self.contributions)


def first_level(maps: Mapping[str, OccupancyGrid]) -> list[LevelMap]:
    """Return original maps, each with a known cell, as the first level, the one with the most known area first."""
    names = sorted(maps, key=lambda name: (*reference_rank(maps[name]), name))
    return [LevelMap(name, {name: Contribution(maps[name], se2.IDENTITY)}, maps[name]) for name in names]


def best_pairs(alignments: Mapping[Pair, Alignment]) -> list[Pair]:
    """Return the pairs of a level to merge: accepted ones, the best first, no map twice."""
    accepted = [pair for pair, found in alignments.items() if found.accepted and found.T_a_b is not None]
    accepted.sort(key=lambda pair: (-(alignments[pair].inliers or 0), -alignments[pair].acceptance, pair))
    used: set[str] = set()
    best = []
    for pair in accepted:
        if not used.intersection(pair):
            used.update(pair)
            best.append(pair)
    return best


def next_level(level: list[LevelMap], alignments: Mapping[Pair, Alignment]) -> list[LevelMap]:
    """Return the maps after the best pairs of a level were merged; as many as before where none was accepted.

    alignments: of pairs of names, the first of them earlier in the level.
    """
    by_name = {each.name: each for each in level}
    number = 1 + max(each.level for each in level)  # each level before this one merged something
    merged = [_merged(by_name.pop(a), by_name.pop(b), alignments[a, b], number) for a, b in best_pairs(alignments)]
    return sorted([*by_name.values(), *merged], key=lambda each: (*reference_rank(each.grid), each.name))


def tree_lines(top: LevelMap, titles: Mapping[str, str], indent: str = "") -> list[str]:
    """Return a merged map as the tree of figure 5.6, a line a map; titles: what the original ones are called."""
    lines = [f"{indent}{titles.get(top.name, f'{len(top.contributions)} maps')}"]
    for part in top.parts or ():
        lines += tree_lines(part, titles, indent + "  ")
    return lines


def _merged(a: LevelMap, b: LevelMap, alignment: Alignment, level: int) -> LevelMap:
    """Return two maps as one, in the frame of the original map with the most known area."""
    T_a_b = alignment.T_a_b
    assert T_a_b is not None, "best_pairs names accepted ones only"
    in_a = {name: each.T_global_map for name, each in a.contributions.items()}
    in_a |= {name: se2.compose(T_a_b, each.T_global_map) for name, each in b.contributions.items()}
    grids = {name: each.grid for part in (a, b) for name, each in part.contributions.items()}
    names = sorted(grids, key=lambda name: (*reference_rank(grids[name]), name))
    reference = in_a[names[0]]
    contributions = {
        name: Contribution(grids[name], se2.between(reference, in_a[name]) if name != names[0] else se2.IDENTITY)
        for name in names
    }
    cells = fuse(contributions)
    return LevelMap("+".join(names), contributions, cells.grid(), (a, b), cells, level, alignment)
