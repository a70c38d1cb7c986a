"""The exact rectangle of the car against the squares of a grid's cells (separating axes), compiled.

Coordinates are those of the grid: metres from its lower-left corner, x along the columns, whatever its origin.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Distances = NDArray[np.float32]
Body = tuple[float, float, float]  # front, rear, half width in m from base_link


@numba.njit(cache=True)
def is_free(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    x: float,
    y: float,
    yaw: float,
    body: Body,
) -> bool:
    """Whether a rectangle at a pose touches no blocked cell and lies inside the grid.

    blocked (rows, cols); distance_m (rows, cols) from a cell's centre to that of the nearest blocked one, which spares
    the exact test in the open.
    """
    front, rear, half_width = body
    rows, cols = blocked.shape
    cos, sin = math.cos(yaw), math.sin(yaw)
    center_x, center_y = x + cos * (front - rear) / 2.0, y + sin * (front - rear) / 2.0
    half_length = (front + rear) / 2.0
    reach_x = abs(cos) * half_length + abs(sin) * half_width
    reach_y = abs(sin) * half_length + abs(cos) * half_width
    if center_x - reach_x < 0.0 or center_y - reach_y < 0.0:
        return False
    if center_x + reach_x > cols * cell_m or center_y + reach_y > rows * cell_m:
        return False
    row, col = min(int(center_y / cell_m), rows - 1), min(int(center_x / cell_m), cols - 1)
    around = math.sqrt(half_length * half_length + half_width * half_width)
    if distance_m[row, col] > around + 1.42 * cell_m:
        return True
    half = cell_m / 2.0
    spread = half * (abs(cos) + abs(sin))
    for i in range(int((center_y - reach_y) / cell_m), min(int((center_y + reach_y) / cell_m), rows - 1) + 1):
        for j in range(int((center_x - reach_x) / cell_m), min(int((center_x + reach_x) / cell_m), cols - 1) + 1):
            if not blocked[i, j]:
                continue
            dx, dy = (j + 0.5) * cell_m - center_x, (i + 0.5) * cell_m - center_y
            along, across = abs(cos * dx + sin * dy), abs(cos * dy - sin * dx)
            if along < half_length + spread and across < half_width + spread:
                return False
    return True


@numba.njit(cache=True)
def clearance_m(
    occupied: Mask,
    distance_m: Distances,
    cell_m: float,
    poses: NDArray[np.float64],
    body: Body,
) -> float:
    """Return the least distance in m between a rectangle at poses (N, 3) and occupied cells; inf if none.

    distance_m as in `is_free`, from the occupied cells.
    """
    front, rear, half_width = body
    rows, cols = occupied.shape
    half_length, half = (front + rear) / 2.0, cell_m / 2.0
    around = math.sqrt(half_length * half_length + half_width * half_width)
    best = math.inf
    for n in range(len(poses)):
        cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        center_x = poses[n, 0] + cos * (front - rear) / 2.0
        center_y = poses[n, 1] + sin * (front - rear) / 2.0
        row = min(max(int(center_y / cell_m), 0), rows - 1)
        col = min(max(int(center_x / cell_m), 0), cols - 1)
        nearest = distance_m[row, col]
        if nearest - around - 1.42 * cell_m > best:
            continue
        window = int(min(best + around, nearest) / cell_m) + int(around / cell_m) + 3
        for i in range(max(row - window, 0), min(row + window, rows - 1) + 1):
            for j in range(max(col - window, 0), min(col + window, cols - 1) + 1):
                if not occupied[i, j]:
                    continue
                dx, dy = (j + 0.5) * cell_m - center_x, (i + 0.5) * cell_m - center_y
                for k in range(4):
                    # Of two convex shapes that do not touch, a corner of the one or of the other is nearest.
                    corner_x, corner_y = dx + half * (1 - 2 * (k & 1)), dy + half * (1 - (k & 2))
                    u = max(abs(cos * corner_x + sin * corner_y) - half_length, 0.0)
                    v = max(abs(cos * corner_y - sin * corner_x) - half_width, 0.0)
                    best = min(best, math.sqrt(u * u + v * v))
                    a, b = half_length * (1 - 2 * (k & 1)), half_width * (1 - (k & 2))
                    u = max(abs(cos * a - sin * b - dx) - half, 0.0)
                    v = max(abs(sin * a + cos * b - dy) - half, 0.0)
                    best = min(best, math.sqrt(u * u + v * v))
    return best
