"""Simulated change: what differs between two real maps of one place besides their shape.

Between two drives people walk, chairs and doors move, and one sensor draws walls thicker than another or misses them.
Windows of one log share all of that. Each map of a pair gets changes of its own.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid

Mask = NDArray[np.uint8]
_WALL, _FREE = 2.5, -2.5  # log-odds of what is drawn
_THICK_SHARE, _THICK_M = 0.5, (0.03, 0.15)  # share of maps with thick walls, and by how much on either side
_THINGS_PER_M2, _THING_M = 0.06, (0.15, 0.8)  # at most so many things, so large
_GAPS_PER_M, _GAP_M = 0.05, (0.3, 1.5)  # at most so many gaps a metre of wall, of such a radius


def changed(grid: OccupancyGrid, random: np.random.Generator) -> OccupancyGrid:
    """Return a map with walls grown, parts of walls gone (seen free, or not seen), and things that were not there."""
    cells = grid.log_odds.copy()
    _grow_walls(cells, grid.resolution_m, random)
    _take_walls(cells, grid.resolution_m, random)
    _put_things(cells, grid.resolution_m, random)
    return OccupancyGrid(cells, grid.resolution_m, grid.origin)


def _grow_walls(cells: NDArray[np.float32], resolution_m: float, random: np.random.Generator) -> None:
    """Make walls thicker, over free space only, in some of the maps."""
    by_m = float(random.uniform(*_THICK_M))
    if random.random() >= _THICK_SHARE or not (cells > 0.0).any():
        return
    distance = cv2.distanceTransform((cells <= 0.0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cells[(cells < 0.0) & (distance * resolution_m <= by_m)] = _WALL


def _take_walls(cells: NDArray[np.float32], resolution_m: float, random: np.random.Generator) -> None:
    """Take discs out of the walls: every second one is seen through, the others were not seen."""
    rows, cols = np.nonzero(cells > 0.0)
    if len(rows) == 0:
        return
    for opened in (True, False):
        count = random.poisson(random.uniform(0.0, 0.5 * _GAPS_PER_M) * len(rows) * resolution_m)
        gone: Mask = np.zeros(cells.shape, np.uint8)
        for at in random.integers(0, len(rows), count).tolist():
            radius = max(1, round(float(random.uniform(*_GAP_M)) / resolution_m))
            cv2.circle(gone, (int(cols[at]), int(rows[at])), radius, (1,), cv2.FILLED)
        walls = (gone > 0) & (cells > 0.0)
        cells[walls if opened else (gone > 0)] = _FREE if opened else 0.0


def _put_things(cells: NDArray[np.float32], resolution_m: float, random: np.random.Generator) -> None:
    """Put turned boxes into the free space; what they hide was seen before, as from another side."""
    rows, cols = np.nonzero(cells < 0.0)
    if len(rows) == 0:
        return
    count = random.poisson(random.uniform(0.0, _THINGS_PER_M2) * len(rows) * resolution_m**2)
    things: Mask = np.zeros(cells.shape, np.uint8)
    for at in random.integers(0, len(rows), count).tolist():
        size = np.maximum(random.uniform(*_THING_M, 2) / resolution_m, 1.0)
        box = cv2.boxPoints(
            ((float(cols[at]), float(rows[at])), tuple(size.tolist()), float(random.uniform(0.0, 90.0)))
        )
        cv2.fillConvexPoly(things, np.rint(box).astype(np.int32), (1,))
    cells[(things > 0) & (cells < 0.0)] = _WALL
