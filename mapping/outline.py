"""The outline of a grid's walls: where they meet free space, which way they face, and how much wall each point is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.wall_map import FREE, WALL, States, WallMap

FloatArray = NDArray[np.float64]
_SMOOTH_M = 0.12  # over so much a wall's direction is taken
_BESIDE_M = 0.06  # so far beside a wall its open side is looked for
_ONE_SIDED = 0.25  # difference in free space between a wall's sides from which one of them is the open one
_STRAIGHT = 0.5  # coherence of the structure tensor, 0..1, from which a wall has a direction


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """points (N, 2) in m in the grid's frame; lengths (N,) in m of wall that each stands for.

    normals (N, 2): unit vectors across the wall; (0, 0) where it has no clear direction. faced (N,): the normal points
    to the side from which the wall was seen; elsewhere, as at a wall of one cell seen from both sides, it has either
    sign.
    """

    points: FloatArray
    lengths: FloatArray
    normals: FloatArray
    faced: NDArray[np.bool_]


def outline_of(walls: WallMap) -> Outline:
    """Return the wall cells that have a free neighbour: the inside of a thick wall, which nothing saw, is dropped."""
    rows, cols = np.divmod(np.flatnonzero(_outline_cells(walls.states)), walls.states.shape[1])
    points = (np.column_stack([cols, rows]) + 0.5) * walls.resolution_m
    normals, straight = _directions(walls.states, rows, cols, walls.resolution_m)
    steepest = np.maximum(np.abs(normals[:, 0]), np.abs(normals[:, 1]))
    # A straight line of length l holds l |cos| / r or l |sin| / r cells, whichever is more.
    lengths = np.asarray(walls.resolution_m / np.where(straight, steepest, 1.0), dtype=np.float64)
    directed = np.where(straight[:, np.newaxis], normals, 0.0).astype(np.float64)
    ahead = _openness(walls, points.astype(np.float64), directed)
    signed = np.where(ahead[:, np.newaxis] < 0.0, -directed, directed)
    return Outline(points.astype(np.float64), lengths, signed, straight & (np.abs(ahead) >= _ONE_SIDED))


def _outline_cells(states: States) -> NDArray[np.bool_]:
    """Return the wall cells with a free cell on one of their four sides."""
    free = np.pad(states == FREE, 1)
    beside = free[:-2, 1:-1] | free[2:, 1:-1] | free[1:-1, :-2] | free[1:-1, 2:]
    return np.asarray((states == WALL) & beside)


def _openness(walls: WallMap, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return how much more free space lies before points (N, 2), the way of their normals, than behind: -1..1."""
    free = cv2.GaussianBlur((walls.states == FREE).astype(np.float32), (0, 0), max(_BESIDE_M / walls.resolution_m, 1.0))
    off = max(1.5 * walls.resolution_m, _BESIDE_M) * normals
    sides = []
    for side in (points + off, points - off):
        cols, rows = np.floor(side / walls.resolution_m).astype(np.intp).T
        sides.append(free[rows.clip(0, free.shape[0] - 1), cols.clip(0, free.shape[1] - 1)].astype(np.float64))
    return np.asarray(sides[0] - sides[1])


def _directions(
    states: States, rows: NDArray[np.intp], cols: NDArray[np.intp], resolution_m: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the unit normals (N, 2) of the walls at cells, from the structure tensor, and where they are clear."""
    sigma = max(_SMOOTH_M / resolution_m, 1.0)
    blurred = cv2.GaussianBlur((states == WALL).astype(np.float32), (0, 0), 0.7 * sigma)
    gx = cv2.Sobel(blurred, cv2.CV_32F, 1, 0)
    gy = cv2.Sobel(blurred, cv2.CV_32F, 0, 1)
    xx, xy, yy = _blurred_at(gx, gy, rows, cols, sigma).T
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    coherence = np.hypot(xx - yy, 2.0 * xy) / np.maximum(xx + yy, 1e-12)
    return np.column_stack([np.cos(angle), np.sin(angle)]), coherence >= _STRAIGHT


@njit(cache=True, nogil=True)
def _blurred_at(
    gx: NDArray[np.float32], gy: NDArray[np.float32], rows: NDArray[np.intp], cols: NDArray[np.intp], sigma: float
) -> FloatArray:
    """Return the Gaussian means (N, 3) of gx gx, gx gy and gy gy about some cells: few of all, so not of the others."""
    reach = math.ceil(3.0 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    means = np.zeros((len(rows), 3))
    for n in range(len(rows)):
        for row in range(max(rows[n] - reach, 0), min(rows[n] + reach + 1, gx.shape[0])):
            for col in range(max(cols[n] - reach, 0), min(cols[n] + reach + 1, gx.shape[1])):
                weight = kernel[row - rows[n] + reach] * kernel[col - cols[n] + reach]
                x, y = gx[row, col], gy[row, col]
                means[n, 0] += weight * x * x
                means[n, 1] += weight * x * y
                means[n, 2] += weight * y * y
    means /= kernel.sum() ** 2
    return means
