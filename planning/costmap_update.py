"""A costmap after a change in a window of its map: what did not change is kept, so that a large map costs no more.

Distances are cut off (see `costmap_layers`), so a changed cell matters up to there and no further. Regions are a matter
of the whole map, but seldom: most changes join and part nothing that is not joined around them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np

from mapping.grid import OccupancyGrid
from planning import costmap_layers as layers
from planning.costmap import Costmap, UnknownSpace
from planning.errors import PlanningError
from planning.footprint import Distances, Mask
from planning.guide import refresh_guide

_AROUND_CELLS = 16  # looked at around a change for ways that lead past it


@dataclass(frozen=True, slots=True)
class Window:
    """Cells of a grid: first row and column, and the row and column after the last."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def cells(self) -> tuple[slice, slice]:
        """The index of the cells."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, cells: int, shape: tuple[int, ...]) -> Window:
        """Return the window with so many cells more on every side, inside an array of the shape."""
        top, left = max(self.top - cells, 0), max(self.left - cells, 0)
        return Window(top, left, min(self.bottom + cells, shape[0]), min(self.right + cells, shape[1]))

    def joined(self, other: Window | None) -> Window:
        """Return the smallest window around both."""
        if other is None:
            return self
        top, left = min(self.top, other.top), min(self.left, other.left)
        return Window(top, left, max(self.bottom, other.bottom), max(self.right, other.right))

    def within(self, outer: Window) -> tuple[slice, slice]:
        """Return the index of the cells in an array of the cells of an outer window."""
        rows = slice(self.top - outer.top, self.bottom - outer.top)
        return rows, slice(self.left - outer.left, self.right - outer.left)


def update(costmap: Costmap, grid: OccupancyGrid, window: Window) -> Costmap:
    """Return the costmap of a grid that differs from the costmap's own in the window only; as a full rebuild.

    Only the numbers of regions may be others than those of a rebuild. The arrays move into the result: the costmap
    given must not be used any more. Raises PlanningError for a grid of another shape, place or resolution.
    """
    old = costmap.grid
    same_place = grid.resolution_m == old.resolution_m and np.array_equal(grid.origin, old.origin)
    if grid.log_odds.shape != old.log_odds.shape or not same_place:
        raise PlanningError("the changed map has another shape, origin or resolution: make a new costmap of it")
    window = window.grown(0, grid.log_odds.shape)
    before = layers.occupied_and_unseen(old.log_odds[window.cells])
    now = layers.occupied_and_unseen(grid.log_odds[window.cells])
    changed = _changed(window, (before[0] != now[0]) | (before[1] != now[1]))
    if changed is None:
        return replace(costmap, grid=grid)
    costmap.occupied[window.cells] = now[0]
    blocked = _changed(window, before[0] != now[0])
    if costmap.unknown is UnknownSpace.forbidden:
        _measure(costmap, costmap.occupied, costmap.to_occupied_m, blocked)
        blocked = _update_blocked(costmap, grid, changed)
    nearer = _measure(costmap, costmap.blocked, costmap.to_blocked_m, blocked)
    return _with_regions_and_costs(costmap, grid, changed.joined(nearer))


def _changed(window: Window, differs: Mask) -> Window | None:
    """Return the smallest window around the cells of a window that differ."""
    rows, cols = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if len(rows) == 0:
        return None
    top, left = window.top, window.left
    return Window(top + int(rows[0]), left + int(cols[0]), top + int(rows[-1]) + 1, left + int(cols[-1]) + 1)


def _update_blocked(costmap: Costmap, grid: OccupancyGrid, changed: Window) -> Window | None:
    """Rewrite blocked cells around a change; return the window of those that differ.

    A patch of unseen cells that became, or ceased to be, a speck has a changed cell, or one beside it, and else fewer
    cells than the car is large: it ends within that many cells.
    """
    least = layers.least_cells(costmap.vehicle, grid.resolution_m)
    shape = costmap.blocked.shape
    part = changed.grown(math.ceil(least) + 1, shape)
    goes_on = (part.left > 0, part.top > 0, part.right < shape[1], part.bottom < shape[0])
    occupied, unseen = layers.occupied_and_unseen(grid.log_odds[part.cells])
    near = np.zeros(unseen.shape, bool)
    near[changed.grown(1, shape).within(part)] = True
    before = costmap.blocked[part.cells]
    blocked = occupied | layers.without_specks_again(unseen, least, near, before, goes_on)
    differs = before != blocked
    costmap.blocked[part.cells] = blocked
    return _changed(part, differs)


def _measure(costmap: Costmap, mask: Mask, distances: Distances, changed: Window | None) -> Window | None:
    """Rewrite distances to the mask around its changed cells; return the window in which they may differ."""
    if changed is None:
        return None
    cell_m = costmap.grid.resolution_m
    cells = math.ceil(costmap.reach_m / cell_m)
    inner = changed.grown(cells, mask.shape)
    outer = inner.grown(cells, mask.shape)
    part = layers.distances_m(np.ascontiguousarray(mask[outer.cells]), cell_m, costmap.reach_m)
    distances[inner.cells] = part[inner.within(outer)]
    return inner


def _with_regions_and_costs(costmap: Costmap, grid: OccupancyGrid, affected: Window) -> Costmap:
    """Rewrite regions and costs where distances or kinds of cells may differ."""
    vehicle = costmap.vehicle
    passable_m = layers.passable_from_m(vehicle, grid.resolution_m)
    distances = np.ascontiguousarray(costmap.to_blocked_m[affected.cells])
    _, unseen = layers.occupied_and_unseen(grid.log_odds[affected.cells])
    costs = layers.route_costs(distances, unseen, passable_m, vehicle.inradius_m, costmap.unknown.route_cost)
    costmap.route_cost[affected.cells] = costs
    window = (affected.top, affected.left, affected.bottom, affected.right)
    refresh_guide(costmap.guide, costmap.route_cost, costmap.to_blocked_m, grid.resolution_m, vehicle, window)
    changed = _changed(affected, (costmap.region[affected.cells] > 0) != (distances >= passable_m))
    if changed is None:
        return replace(costmap, grid=grid)
    around = changed.grown(_AROUND_CELLS, costmap.region.shape)
    part = _relabelled(costmap, costmap.to_blocked_m[around.cells] >= passable_m, changed, around)
    if part is None:
        regions, region = layers.connected(costmap.to_blocked_m >= passable_m)
        return replace(costmap, grid=grid, regions=regions, region=region)
    costmap.region[around.cells] = part
    return replace(costmap, grid=grid, regions=max(costmap.regions, int(part.max()) + 1))


def _relabelled(costmap: Costmap, passable: Mask, changed: Window, around: Window) -> layers.Regions | None:
    """Return the regions around a change; None where it joins or parts regions of the map, or may do so.

    passable is that of the cells around. What was joined there outside the change, and still is, is joined as before
    everywhere, however the ways lead.
    """
    before = np.ascontiguousarray(costmap.region[around.cells])
    patches, old = layers.connected(before > 0)
    count, new = layers.connected(passable)
    rows, cols = changed.within(around)
    numbers = _numbers(before, old, new, (patches, count), (rows.start, rows.stop, cols.start, cols.stop))
    if numbers[0] < 0:
        return None
    fresh = np.flatnonzero(numbers[1:] == 0) + 1
    numbers[fresh] = costmap.regions + np.arange(len(fresh))
    return np.asarray(numbers[new])


@numba.njit(cache=True)
def _numbers(
    before: layers.Regions,
    old: layers.Regions,
    new: layers.Regions,
    counts: tuple[int, int],
    changed: tuple[int, int, int, int],
) -> layers.Regions:
    """Return the region of each new patch that reaches out of the changed cells, 0 of the others.

    The first is -1 if an old patch falls apart, or a new one joins two regions. old and new (rows, cols) number the
    patches, so many as counts say; changed: first row, row after the last, first column, column after the last.
    """
    numbers, becomes = np.zeros(counts[1], np.int32), np.zeros(counts[0], np.int32)
    top, bottom, left, right = changed
    for i in range(before.shape[0]):
        for j in range(before.shape[1]):
            patch = new[i, j]
            if patch == 0 or (top <= i < bottom and left <= j < right):
                continue
            if (becomes[old[i, j]] > 0 and becomes[old[i, j]] != patch) or (
                numbers[patch] > 0 and numbers[patch] != before[i, j]
            ):
                numbers[0] = -1
                return numbers
            becomes[old[i, j]], numbers[patch] = patch, before[i, j]
    return numbers
