"""Cells of one grid looked up from another one: the nearest cell, so that evidence is neither blurred nor invented."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import LogOdds, OccupancyGrid

FloatArray = NDArray[np.float64]
_ROWS_AT_ONCE = 256  # bounds the memory of the coordinates


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """The geometry of a grid without its cells: (rows, cols), metres a cell, pose (3,) of its lower-left corner."""

    shape: tuple[int, int]
    resolution_m: float
    origin: FloatArray


def raster_of(grid: OccupancyGrid) -> Raster:
    """Return the geometry of a grid."""
    rows, cols = grid.log_odds.shape
    return Raster((rows, cols), grid.resolution_m, grid.origin)


def known_corners(grid: OccupancyGrid) -> FloatArray:
    """Return the corners (4, 2) in the map frame of the smallest box, along the cells, around all known cells.

    (0, 2) where nothing is known.
    """
    known = grid.known
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        return np.empty((0, 2))
    x0, x1, y0, y1 = cols[0], cols[-1] + 1, rows[0], rows[-1] + 1
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=np.float64)
    return se2.transform_points(grid.origin, corners * grid.resolution_m)


def cut_to_known(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the grid without its rim of unknown cells; as it is where nothing is known."""
    known = grid.known
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if len(rows) == 0:
        return grid
    cells = grid.log_odds[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    corner = np.array([cols[0] * grid.resolution_m, rows[0] * grid.resolution_m, 0.0])
    return OccupancyGrid(cells, grid.resolution_m, se2.compose(grid.origin, corner))


def raster_around(points: FloatArray, resolution_m: float) -> Raster:
    """Return the raster, upright and on whole cells of its frame, that covers points (N, 2) with N >= 1."""
    low = np.floor(points.min(axis=0) / resolution_m + 1e-6)
    high = np.maximum(np.ceil(points.max(axis=0) / resolution_m - 1e-6), low + 1)
    cols, rows = (high - low).astype(int).tolist()
    return Raster((rows, cols), resolution_m, np.array([*(low * resolution_m), 0.0]))


def resample(grid: OccupancyGrid, T_target_map: FloatArray, raster: Raster) -> LogOdds:
    """Return the log-odds (rows, cols) that a grid has at the centres of a raster's cells in the target frame.

    Unknown, 0, outside of the grid. T_target_map (3,) is the pose of the grid's map frame in the raster's frame.
    """
    rows, cols = raster.shape
    # From the raster's cells to the grid's: a turn, a scale and a shift.
    x, y, turn = se2.compose(se2.inverse(se2.compose(T_target_map, grid.origin)), raster.origin).tolist()
    scale = raster.resolution_m / grid.resolution_m
    cos, sin = math.cos(turn) * scale, math.sin(turn) * scale
    across = np.arange(cols) + 0.5
    result = np.zeros(raster.shape, np.float32)
    height, width = grid.log_odds.shape
    for first in range(0, rows, _ROWS_AT_ONCE):
        up = (np.arange(first, min(first + _ROWS_AT_ONCE, rows)) + 0.5)[:, np.newaxis]
        col = np.floor(x / grid.resolution_m + cos * across - sin * up + 1e-9).astype(np.int64)
        row = np.floor(y / grid.resolution_m + sin * across + cos * up + 1e-9).astype(np.int64)
        inside = (col >= 0) & (col < width) & (row >= 0) & (row < height)
        part = result[first : first + _ROWS_AT_ONCE]
        part[inside] = grid.log_odds[row[inside], col[inside]]
    return result
