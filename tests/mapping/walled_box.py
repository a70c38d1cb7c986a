"""A small room of the maps that matching is tried on, and how its walls face."""

from __future__ import annotations

import numpy as np

from mapping.grid import OccupancyGrid
from mapping.wall_faces import WallFaces, wall_faces
from mapping.wall_map import wall_map

CELL_M = 0.05


def box() -> OccupancyGrid:
    """A free room of 4 x 3 m with walls of one cell, unknown around it."""
    cells = np.zeros((80, 100), np.float32)
    cells[10:71, 10:91] = -3.0
    cells[[10, 70], 10:91] = cells[10:71, [10, 90]] = 3.0
    return OccupancyGrid(cells, CELL_M, np.zeros(3))


def faces_of(grid: OccupancyGrid) -> WallFaces:
    return wall_faces(wall_map(grid, free_below=-0.4))


def towards(place: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Facings of surfaces that turn to a place (2,)."""
    return np.arctan2(*(place - points).T[::-1])
