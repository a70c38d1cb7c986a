"""The outline of a grid's walls: where they meet free space, which way they face, and how much wall each point is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.wall_map import FREE, WALL, States, WallMap

FloatArray = NDArray[np.float64]
_SMOOTH_M = 0.12  # over so much a wall's direction is taken
_STRAIGHT = 0.5  # coherence of the structure tensor, 0..1, from which a wall has a direction


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """points (N, 2) in m in the grid's frame; lengths (N,) in m of wall that each stands for.

    normals (N, 2): unit vectors across the wall, of either sign; (0, 0) where it has no clear direction.
    """

    points: FloatArray
    lengths: FloatArray
    normals: FloatArray


def outline_of(walls: WallMap) -> Outline:
    """Return the wall cells that have a free neighbour: the inside of a thick wall, which nothing saw, is dropped."""
    rows, cols = np.nonzero(_outline_cells(walls.states))
    points = (np.column_stack([cols, rows]) + 0.5) * walls.resolution_m
    normals, straight = _directions(walls.states, rows, cols, walls.resolution_m)
    steepest = np.maximum(np.abs(normals[:, 0]), np.abs(normals[:, 1]))
    # A straight line of length l holds l |cos| / r or l |sin| / r cells, whichever is more.
    lengths = np.asarray(walls.resolution_m / np.where(straight, steepest, 1.0), dtype=np.float64)
    directed = np.where(straight[:, np.newaxis], normals, 0.0).astype(np.float64)
    return Outline(points.astype(np.float64), lengths, directed)


def _outline_cells(states: States) -> NDArray[np.bool_]:
    """Return the wall cells with a free cell on one of their four sides."""
    free = np.pad(states == FREE, 1)
    beside = free[:-2, 1:-1] | free[2:, 1:-1] | free[1:-1, :-2] | free[1:-1, 2:]
    return np.asarray((states == WALL) & beside)


def _directions(
    states: States, rows: NDArray[np.intp], cols: NDArray[np.intp], resolution_m: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the unit normals (N, 2) of the walls at cells, from the structure tensor, and where they are clear."""
    sigma = max(_SMOOTH_M / resolution_m, 1.0)
    blurred = cv2.GaussianBlur((states == WALL).astype(np.float32), (0, 0), 0.7 * sigma)
    gx = cv2.Sobel(blurred, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(blurred, cv2.CV_32F, 0, 1)
    xx, xy, yy = (cv2.GaussianBlur(part, (0, 0), sigma)[rows, cols] for part in (gx * gx, gx * gy, gy * gy))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy).astype(np.float64)
    coherence = np.hypot(xx - yy, 2.0 * xy) / np.maximum(xx + yy, 1e-12)
    return np.column_stack([np.cos(angle), np.sin(angle)]), coherence >= _STRAIGHT
