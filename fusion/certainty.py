"""Stage 6 of Algorithm 3: the cells of any number of maps joined by Bayes' rule (thesis section 3.6.2).

Evidence is summed as whole numbers of 2^-40 of log-odds: no order of maps gives another sum, and what was added can be
taken away again, bit for bit. Each map is looked up on the global cells by the inverse transform, the nearest cell, on
a raster of its own that no other map moves. What each map said is kept, so a sum can always be made anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.identity import content_hash, known_area_m2, later_version, may_be_later_version, same_evidence
from fusion.resampling import known_corners, raster_around, resample
from mapping import se2
from mapping.grid import LOG_ODDS_CLAMP, OccupancyGrid

FloatArray = NDArray[np.float64]
Sums = NDArray[np.int64]
_UNITS = 2.0**40  # a unit of log-odds; 2^20 maps at the clamp fit into 63 bits


@dataclass(frozen=True, slots=True, eq=False)
class Contribution:
    """A map and the pose (3,) of its frame in the global frame; it must have a known cell."""

    grid: OccupancyGrid
    T_global_map: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CertaintyGrid:
    """The evidence of named maps on whole cells of the global frame; a value, which `added` and `removed` leave alone.

    sums (rows, cols): log-odds in 2^-40, not clamped; low: column and row, in the global frame, of the first cell.
    within: for each map that counts for nothing because another one holds all that it says, the name of that one: the
    same map again, or a later version of it.
    """

    resolution_m: float
    contributions: Mapping[str, Contribution]
    within: Mapping[str, str] = field(default_factory=dict)
    sums: Sums = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    low: tuple[int, int] = (0, 0)

    def added(self, name: str, contribution: Contribution) -> CertaintyGrid:
        """Return the grid with one more map; raises ValueError for a name that is there already."""
        if name in self.contributions:
            raise ValueError(f"{name}: has been added already")
        return self._with({**self.contributions, name: contribution})

    def removed(self, name: str) -> CertaintyGrid:
        """Return the grid without a map, as if it never had been added; raises KeyError for an unknown name."""
        others = dict(self.contributions)
        del others[name]
        return self._with(others)

    def grid(self) -> OccupancyGrid:
        """Return the map: log-odds clamped as every grid's are, without its unknown rim; at least one map is needed."""
        cells = np.clip(self.sums / _UNITS, -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP).astype(np.float32)
        rows, cols = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
        if len(rows) == 0:  # all evidence cancels
            return OccupancyGrid(np.zeros((1, 1), np.float32), self.resolution_m, np.zeros(3))
        corner = self.low[0] + int(cols[0]), self.low[1] + int(rows[0])
        origin = np.array([corner[0] * self.resolution_m, corner[1] * self.resolution_m, 0.0])
        return OccupancyGrid(cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1], self.resolution_m, origin)

    def _with(self, contributions: Mapping[str, Contribution]) -> CertaintyGrid:
        """Return the grid of other maps: only what differs is looked up, unless the cell changes."""
        within = _held_by_others(contributions)
        resolution_m = min((each.grid.resolution_m for each in contributions.values()), default=self.resolution_m)
        sums, low = self.sums, self.low
        before = _counting(self.contributions, self.within)
        if resolution_m != self.resolution_m:
            sums, low, before = np.zeros((0, 0), np.int64), (0, 0), {}
        after = _counting(contributions, within)
        changes = [(each, -1) for name, each in before.items() if after.get(name) is not each]
        changes += [(each, 1) for name, each in after.items() if before.get(name) is not each]
        for contribution, sign in changes:
            sums, low = _summed(sums, low, *_units_of(contribution, resolution_m), sign)
        return CertaintyGrid(resolution_m, contributions, within, sums, low)


def fuse(contributions: Mapping[str, Contribution]) -> CertaintyGrid:
    """Return the certainty grid of named maps, at the finest of their resolutions; the order changes nothing."""
    if not contributions:
        raise ValueError("no map to fuse")
    return CertaintyGrid(0.0, {})._with(dict(contributions))


def _held_by_others(contributions: Mapping[str, Contribution]) -> dict[str, str]:
    """Return for each map that another one holds all of, the name of that one, which itself counts."""
    hashes = {name: content_hash(each.grid) for name, each in contributions.items()}
    areas = {name: known_area_m2(each.grid) for name, each in contributions.items()}
    corners = {name: known_corners(each.grid) for name, each in contributions.items()}
    # Of equals the one counts whose cells come first, whatever the names are: a name says nothing about evidence.
    ranked = sorted(
        contributions, key=lambda name: (-areas[name], hashes[name], contributions[name].grid.log_odds.tobytes(), name)
    )
    counting: list[str] = []
    within: dict[str, str] = {}
    for name in ranked:
        mine = contributions[name]
        # Of many maps few can hold another one: what rules most of them out is asked first, as it looks at no cell.
        candidates = [other for other in counting if hashes[other] == hashes[name]]
        candidates += [other for other in counting if _may_hold(contributions[other], mine, corners[name])]
        holder = next((other for other in candidates if _holds(contributions[other], mine)), None)
        if holder is None:
            counting.append(name)
        else:
            within[name] = holder
    return within


def _may_hold(later: Contribution, earlier: Contribution, corners: FloatArray) -> bool:
    T_later_earlier = se2.between(later.T_global_map, earlier.T_global_map)
    return may_be_later_version(later.grid, earlier.grid, T_later_earlier, corners)


def _holds(later: Contribution, earlier: Contribution) -> bool:
    T_later_earlier = se2.between(later.T_global_map, earlier.T_global_map)
    return same_evidence(later.grid, earlier.grid) or later_version(later.grid, earlier.grid, T_later_earlier)


def _counting(contributions: Mapping[str, Contribution], within: Mapping[str, str]) -> dict[str, Contribution]:
    return {name: each for name, each in contributions.items() if name not in within}


def _units_of(contribution: Contribution, resolution_m: float) -> tuple[Sums, tuple[int, int]]:
    """Return what a map says about global cells (rows, cols) in 2^-40, and column and row of the first of them."""
    grid, T_global_map = contribution.grid, np.asarray(contribution.T_global_map, np.float64)
    raster = raster_around(se2.transform_points(T_global_map, known_corners(grid)), resolution_m)
    cells = resample(grid, T_global_map, raster).astype(np.float64)
    col, row = np.rint(raster.origin[:2] / resolution_m).astype(int).tolist()
    return np.rint(cells * _UNITS).astype(np.int64), (col, row)


def _summed(
    sums: Sums, low: tuple[int, int], more: Sums, at: tuple[int, int], sign: int
) -> tuple[Sums, tuple[int, int]]:
    """Return sums, grown as far as needed, with `more` at column and row `at` added or taken away."""
    if sums.size == 0:
        return sign * more, at
    boxes = ((low, sums.shape), (at, more.shape))
    left, below = (min(corner[axis] for corner, _ in boxes) for axis in (0, 1))
    right = max(corner[0] + shape[1] for corner, shape in boxes)
    above = max(corner[1] + shape[0] for corner, shape in boxes)
    total = np.zeros((above - below, right - left), np.int64)
    for (corner, shape), part, factor in zip(boxes, (sums, more), (1, sign), strict=True):
        row, col = corner[1] - below, corner[0] - left
        total[row : row + shape[0], col : col + shape[1]] += factor * part
    return total, (left, below)
