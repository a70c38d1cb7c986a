"""A saved map made ready for localisation: its walls (see wall_map), and a field to search everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.correlation import LikelihoodField, likelihood_field
from mapping.grid import OccupancyGrid
from mapping.wall_faces import WallFaces, wall_faces
from mapping.wall_map import FREE, UNKNOWN, WALL, WallMap, middles, wall_map

_SEARCH_CELL_M = 0.1
_SIGMA_M = 0.12  # of a search cell's likelihood: half its diagonal, and what a wall may be off
FREE_BELOW = -0.4  # log-odds


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceMap:
    """What localisation needs of a map.

    faces: its walls, and from where they can be seen; field to search, None for a map without walls; standing: the
    field's cells where a robot may stand.
    """

    faces: WallFaces
    field: LikelihoodField | None
    standing: NDArray[np.bool_]

    @property
    def walls(self) -> WallMap:
        """The walls, from whichever side they are seen."""
        return self.faces.walls


def reference_map(grid: OccupancyGrid) -> ReferenceMap:
    """Prepare a map; any grid will do, one without walls as well (nothing is ever found in it)."""
    walls = wall_map(grid, free_below=FREE_BELOW)
    faces = wall_faces(walls)
    points = middles(walls.states == WALL, grid.resolution_m)
    if len(points) == 0:
        return ReferenceMap(faces, None, np.zeros((1, 1), np.bool_))
    seen = middles(walls.states != UNKNOWN, grid.resolution_m)
    corners = np.array([seen.min(axis=0), seen.max(axis=0)])
    cell_m = max(_SEARCH_CELL_M, grid.resolution_m)
    field = likelihood_field(points, cell_m, _SIGMA_M * cell_m / _SEARCH_CELL_M, cover=corners)
    standing = np.zeros(field.pyramid.shape[1:], np.uint8)
    free = middles(walls.states == FREE, grid.resolution_m)
    col, row = np.floor((free - field.origin) / cell_m).astype(np.int64).T
    standing[row, col] = 1
    near = np.asarray(cv2.dilate(standing, np.ones((3, 3), np.uint8)) > 0)
    return ReferenceMap(faces, field, near)
