"""A saved map made ready for localisation: distances to its walls, what it knows, and a field to search everywhere.

Everything here is in the grid's own frame, whose origin is the lower-left corner of cell (0, 0): the map frame apart
from the rigid motion `OccupancyGrid.origin`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.correlation import LikelihoodField, likelihood_field
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
Distances = NDArray[np.float32]
States = NDArray[np.uint8]

UNKNOWN, FREE, WALL = 0, 1, 2
FAR_M = 2.0  # distances end here, and outside the grid everything is as far
_SEARCH_CELL_M = 0.1
_SIGMA_M = 0.12  # of a search cell's likelihood: half its diagonal, and what a wall may be off
_FREE_BELOW, _WALL_ABOVE = -0.4, 0.62  # log-odds


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceMap:
    """What localisation needs of a map.

    distances (rows, cols) in m from each cell's middle to the nearest wall cell's, states (rows, cols) of UNKNOWN,
    FREE, WALL; field to search, None for a map without walls, and the field's cells where a robot may stand.
    """

    distances: Distances
    states: States
    resolution_m: float
    T_map_grid: FloatArray
    field: LikelihoodField | None
    standing: NDArray[np.bool_]


def reference_map(grid: OccupancyGrid) -> ReferenceMap:
    """Prepare a map; any grid will do, one without walls as well (nothing is ever found in it)."""
    states = np.full(grid.log_odds.shape, UNKNOWN, np.uint8)
    states[grid.log_odds < _FREE_BELOW] = FREE
    states[grid.log_odds > _WALL_ABOVE] = WALL
    wall = states == WALL
    if not wall.any():
        nowhere = np.zeros((1, 1), np.bool_)
        return ReferenceMap(
            np.full(wall.shape, FAR_M, np.float32), states, grid.resolution_m, grid.origin, None, nowhere
        )
    cells = cv2.distanceTransform((~wall).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distances = np.minimum(cells * np.float32(grid.resolution_m), np.float32(FAR_M))
    known = states != UNKNOWN
    walls, seen = (_middles(mask, grid.resolution_m) for mask in (wall, known))
    corners = np.array([seen.min(axis=0), seen.max(axis=0)])
    cell_m = max(_SEARCH_CELL_M, grid.resolution_m)
    field = likelihood_field(walls, cell_m, _SIGMA_M * cell_m / _SEARCH_CELL_M, cover=corners)
    standing = np.zeros(field.pyramid.shape[1:], np.uint8)
    col, row = np.floor((_middles(states == FREE, grid.resolution_m) - field.origin) / cell_m).astype(np.int64).T
    standing[row, col] = 1
    near = np.asarray(cv2.dilate(standing, np.ones((3, 3), np.uint8)) > 0)
    return ReferenceMap(distances, states, grid.resolution_m, grid.origin, field, near)


def _middles(mask: NDArray[np.bool_], resolution_m: float) -> FloatArray:
    rows, cols = np.nonzero(mask)
    return np.asarray((np.column_stack([cols, rows]) + 0.5) * resolution_m, dtype=np.float64)
