"""What matching needs of a grid: where its walls are, how far every cell is from them, and what it knows.

Everything here is in the grid's own frame, whose origin is the lower-left corner of cell (0, 0): the map frame apart
from the rigid motion `OccupancyGrid.origin`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
Distances = NDArray[np.float32]
States = NDArray[np.uint8]

UNKNOWN, FREE, WALL = 0, 1, 2
FAR_M = 2.0  # distances end here, and outside the grid everything is as far
WALL_ABOVE = 0.62  # log-odds of p = 0.65


@dataclass(frozen=True, slots=True, eq=False)
class WallMap:
    """distances (rows, cols) in m from each cell's middle to the nearest wall cell's; states of UNKNOWN, FREE, WALL."""

    distances: Distances
    states: States
    resolution_m: float
    T_map_grid: FloatArray


def wall_map(grid: OccupancyGrid, *, free_below: float) -> WallMap:
    """Return the walls of a grid; cells with log-odds under `free_below` count as free. One without walls will do."""
    states = np.full(grid.log_odds.shape, UNKNOWN, np.uint8)
    states[grid.log_odds < free_below] = FREE
    states[grid.log_odds > WALL_ABOVE] = WALL
    return WallMap(distances_to(states == WALL, grid.resolution_m), states, grid.resolution_m, grid.origin)


def distances_to(walls: NDArray[np.bool_], resolution_m: float) -> Distances:
    """Return the distance (rows, cols) in m from each cell's middle to the nearest wall cell's, at most FAR_M."""
    if not walls.any():
        return np.full(walls.shape, FAR_M, np.float32)
    cells = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # OpenCV's roots differ in the last bit from call to call; their squares are whole numbers, so they can be mended.
    np.minimum(cells, np.float32(FAR_M / resolution_m + 1.0), out=cells)
    np.sqrt(np.rint(np.square(cells, out=cells), out=cells), out=cells)
    cells *= np.float32(resolution_m)
    return np.asarray(np.minimum(cells, np.float32(FAR_M), out=cells), dtype=np.float32)


def middles(mask: NDArray[np.bool_], resolution_m: float) -> FloatArray:
    """Return the middles (N, 2) in m of the cells that are set."""
    rows, cols = np.nonzero(mask)
    return np.asarray((np.column_stack([cols, rows]) + 0.5) * resolution_m, dtype=np.float64)
