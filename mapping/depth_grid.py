"""The occupancy grid of a depth camera, and the grids of two sensors on one car as one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.depth_sensor_model import DepthModel
from mapping.errors import MappingError
from mapping.grid import LOG_ODDS_CLAMP, GrowingCells, OccupancyGrid
from mapping.raycast import integrate_rays
from mapping.virtual_scan import VirtualScan

FloatArray = NDArray[np.float64]

_KNOWN = 1e-3  # a known cell whose evidence cancels; exactly 0 means unknown


class DepthGridBuilder:
    """Grows an occupancy grid from virtual scans at known poses."""

    def __init__(self, resolution_m: float, model: DepthModel) -> None:
        self._model = model
        self._cells = GrowingCells(resolution_m)
        self._unused = np.zeros_like(self._cells.log_odds)  # changed by rays that must leave the map as it is
        self._scans = 0

    def add_scan(self, pose: FloatArray, scan: VirtualScan) -> None:
        """Add the evidence of a scan taken by a car at pose (3,), the pose of base_link in the map frame."""
        cells = self._cells
        points, evidence = self._model.hits(scan, cells.resolution_m)
        begin, end = self._model.free(scan)
        directions = np.stack([np.cos(scan.angles_rad), np.sin(scan.angles_rad)], axis=1)[end > 0.0]
        ends, blind = (scan.origin + directions * reach[end > 0.0, np.newaxis] for reach in (end, begin))
        parts = (scan.origin[np.newaxis], points, blind, ends)
        placed = se2.transform_points(pose, np.vstack(parts)) / cells.resolution_m
        cells.grow_to(np.floor(placed).astype(np.int64))
        if self._unused.shape != cells.log_odds.shape:
            self._unused = np.zeros_like(cells.log_odds)
        self._scans += 1
        start, hits, blind, ends = np.split(placed - cells.low, np.cumsum([len(part) for part in parts[:-1]]))
        self._mark(hits.astype(np.intp), evidence)
        self._pass(self._unused, start[0], blind, 0.0)  # visits the cells only
        self._pass(cells.log_odds, start[0], ends, self._model.miss_log_odds)

    def grid(self) -> OccupancyGrid:
        """Return the map so far, cut to its known cells; its origin lies on whole cells."""
        return self._cells.grid()

    def _pass(self, values: NDArray[np.float32], start: FloatArray, ends: FloatArray, evidence: float) -> None:
        """Add evidence in values (rows, cols) to the cells on rays to ends (N, 2) not visited by this scan yet."""
        none = np.zeros(len(ends))
        no_hit = none.astype(np.bool_)
        integrate_rays(values, self._cells.visited, self._scans, start, ends, no_hit, none, evidence, LOG_ODDS_CLAMP)

    def _mark(self, cells: NDArray[np.intp], evidence: FloatArray) -> None:
        """Add to each of the cells (K, 2), x and y, the greatest evidence (K,) for it, and visit it in this scan."""
        log_odds, visited = self._cells.log_odds, self._cells.visited
        flat = cells[:, 1] * log_odds.shape[1] + cells[:, 0]
        order = np.lexsort((evidence, flat))
        last = np.flatnonzero(np.diff(flat[order], append=-1))
        cell, gain = flat[order][last], evidence[order][last].astype(np.float32)
        raised = np.minimum(log_odds.reshape(-1)[cell] + gain, np.float32(LOG_ODDS_CLAMP))
        log_odds.reshape(-1)[cell] = np.where(raised == 0.0, np.float32(_KNOWN), raised)
        visited.reshape(-1)[cell] = self._scans


def add_grids(first: OccupancyGrid, second: OccupancyGrid) -> OccupancyGrid:
    """Return one grid of what two sensors found out in one map frame: by Bayes' rule, the log-odds added.

    Both must have the same resolution and origins that are whole cells apart and turned alike, as builders make them;
    raises MappingError otherwise. Adding an unknown grid changes nothing, and the order does not matter.
    """
    if first.resolution_m != second.resolution_m or first.origin[2] != second.origin[2]:
        raise MappingError(
            f"grids of {first.resolution_m} m at {first.origin[2]} rad and {second.resolution_m} m at "
            f"{second.origin[2]} rad cannot be added cell by cell: build both with one resolution in one frame"
        )
    apart = second.origin[:2] / second.resolution_m - first.origin[:2] / first.resolution_m
    cells = np.rint(apart if first.origin[2] == 0.0 else _turned(apart, -first.origin[2])).astype(np.int64)
    if np.abs(apart - _turned(cells, first.origin[2])).max() > 1e-3:
        raise MappingError(f"grids whose corners are {apart} cells apart cannot be added cell by cell: resample one")
    shapes = [np.array(grid.log_odds.shape[::-1]) for grid in (first, second)]
    corners = [np.zeros(2, np.int64), cells]
    low = np.minimum(*corners)
    high = np.maximum(corners[0] + shapes[0], corners[1] + shapes[1])
    total = np.zeros((high - low)[::-1], np.float32)
    known = np.zeros(total.shape, np.bool_)
    for grid, corner, shape in zip((first, second), corners, shapes, strict=True):
        (x0, y0), (x1, y1) = corner - low, corner - low + shape
        total[y0:y1, x0:x1] += grid.log_odds
        known[y0:y1, x0:x1] |= grid.known
    total = np.clip(total, -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP)
    total[known & (total == 0.0)] = _KNOWN
    origin = first.origin.copy()
    origin[:2] += _turned(low * first.resolution_m, first.origin[2])
    return OccupancyGrid(total, first.resolution_m, origin)


def _turned(vector: NDArray[np.int64] | FloatArray, angle_rad: float) -> FloatArray:
    """Return the vector (2,) turned counter-clockwise."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
