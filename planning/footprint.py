"""The car's convex outline against the squares of a grid's cells (separating axes), exact and compiled.

Coordinates are those of the grid: metres from its lower-left corner, x along the columns, whatever its origin.
`blocked` is (rows, cols); `distance_m` (rows, cols) is from a cell's centre to that of the nearest blocked one, cut off
where the costmap cuts it off; `corners` (K, 2) go counter-clockwise around base_link, in m. Outside the grid nothing is
free; touching is not colliding.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
Distances = NDArray[np.float32]

_DIAGONAL = 1.4143  # of a cell: half for where in its cell a point lies, half for the square of a blocked one


@numba.njit(cache=True)
def is_free(
    blocked: Mask, distance_m: Distances, cell_m: float, x: float, y: float, yaw: float, corners: FloatArray
) -> bool:
    """Whether the car at a pose touches no blocked cell and lies inside the grid."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    low_x, high_x, low_y, high_y = bounds(corners, x, y, cos, sin)
    rows, cols = blocked.shape
    if not (low_x >= 0.0 and low_y >= 0.0 and high_x <= cols * cell_m and high_y <= rows * cell_m):
        return False
    around_m, room_m = _room(distance_m, cell_m, x, y, cos, sin, corners)
    if room_m > around_m + _DIAGONAL * cell_m:
        return True
    if room_m == 0.0:  # the middle stands in a blocked cell
        return False
    half = cell_m / 2.0
    for i in range(int(low_y / cell_m), min(math.ceil(high_y / cell_m), rows)):
        j, last = int(low_x / cell_m), min(math.ceil(high_x / cell_m), cols) - 1
        while j <= last:
            if blocked[i, j]:
                if separation_m(corners, cos, sin, (j + 0.5) * cell_m - x, (i + 0.5) * cell_m - y, half) < 0.0:
                    return False
                j += 1
            else:
                j += max(1, int(distance_m[i, j] / cell_m))
    return True


@numba.njit(cache=True)
def poses_are_free(blocked: Mask, distance_m: Distances, cell_m: float, poses: FloatArray, corners: FloatArray) -> int:
    """Return the index of the first of poses (N, 3) at which the car is not free; -1 if it is at all of them."""
    for n in range(len(poses)):
        if not is_free(blocked, distance_m, cell_m, poses[n, 0], poses[n, 1], poses[n, 2], corners):
            return n
    return -1


@numba.njit(cache=True)
def free_length_m(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    x: float,
    y: float,
    yaw: float,
    corners: FloatArray,
    outer_radius_m: float,
) -> float:
    """Return a distance in m that every point of the car may move, however it turns, and still be free; -1 if not free.

    A lower bound: up to half of outer_radius_m by separating axes, which underrate a gap between two corners; further
    out by the distance at base_link.
    """
    rows, cols = blocked.shape
    width_m, height_m = cols * cell_m, rows * cell_m
    if not (x >= 0.0 and y >= 0.0 and x < width_m and y < height_m and math.isfinite(yaw)):
        return -1.0
    reach_m = outer_radius_m / 2.0
    row, col = min(int(y / cell_m), rows - 1), min(int(x / cell_m), cols - 1)
    nearest_m = float(distance_m[row, col]) - _DIAGONAL * cell_m
    far_m: float = min(nearest_m, x, width_m - x, y, height_m - y) - outer_radius_m
    if far_m > reach_m:
        return far_m
    cos, sin = math.cos(yaw), math.sin(yaw)
    low_x, high_x, low_y, high_y = bounds(corners, x, y, cos, sin)
    best: float = min(low_x, width_m - high_x, low_y, height_m - high_y)
    if not best >= 0.0:
        return -1.0
    best, half = min(best, reach_m), cell_m / 2.0
    for i in range(max(int((low_y - best) / cell_m), 0), min(math.ceil((high_y + best) / cell_m), rows)):
        above = max(i * cell_m - high_y, low_y - (i + 1) * cell_m)
        if above >= best:
            continue
        j, last = max(int((low_x - best) / cell_m), 0), min(math.ceil((high_x + best) / cell_m), cols) - 1
        while j <= last:
            if not blocked[i, j]:
                j += max(1, int(distance_m[i, j] / cell_m))
                continue
            apart = separation_m(corners, cos, sin, (j + 0.5) * cell_m - x, (i + 0.5) * cell_m - y, half)
            apart = max(apart, above, j * cell_m - high_x, low_x - (j + 1) * cell_m)
            if apart < 0.0:
                return -1.0
            best = min(best, apart)
            j += 1
    return best


@numba.njit(cache=True)
def clearance_m(occupied: Mask, distance_m: Distances, cell_m: float, poses: FloatArray, corners: FloatArray) -> float:
    """Return the least distance in m between the car at poses (N, 3) and occupied cells; inf if there are none.

    distance_m (rows, cols) must be the true distance from a cell's centre to that of the nearest occupied one.
    """
    rows, cols = occupied.shape
    half = cell_m / 2.0
    best = math.inf
    for n in range(len(poses)):
        x, y = poses[n, 0], poses[n, 1]
        cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        around = 0.0
        for k in range(len(corners)):
            around = max(around, math.hypot(corners[k, 0], corners[k, 1]))
        row, col = min(max(int(y / cell_m), 0), rows - 1), min(max(int(x / cell_m), 0), cols - 1)
        nearest = distance_m[row, col]
        if nearest - around - _DIAGONAL * cell_m > best:
            continue
        window = int(min(best + around, nearest) / cell_m) + int(around / cell_m) + 4
        for i in range(max(row - window, 0), min(row + window, rows - 1) + 1):
            j, last = max(col - window, 0), min(col + window, cols - 1)
            while j <= last:
                if not occupied[i, j]:
                    j += max(1, int(distance_m[i, j] / cell_m))
                    continue
                dx, dy = (j + 0.5) * cell_m - x, (i + 0.5) * cell_m - y
                if math.hypot(dx, dy) - around - _DIAGONAL * half < best:
                    best = min(best, _distance_to_square_m(corners, cos, sin, dx, dy, half))
                j += 1
    return best


@numba.njit(cache=True)
def bounds(corners: FloatArray, x: float, y: float, cos: float, sin: float) -> tuple[float, float, float, float]:
    """Return the least and greatest x and y of the car."""
    low_x = high_x = x + cos * corners[0, 0] - sin * corners[0, 1]  # not infinite: a pose that is no number stays none
    low_y = high_y = y + sin * corners[0, 0] + cos * corners[0, 1]
    for k in range(1, len(corners)):
        corner_x = x + cos * corners[k, 0] - sin * corners[k, 1]
        corner_y = y + sin * corners[k, 0] + cos * corners[k, 1]
        low_x, high_x = min(low_x, corner_x), max(high_x, corner_x)
        low_y, high_y = min(low_y, corner_y), max(high_y, corner_y)
    return low_x, high_x, low_y, high_y


@numba.njit(cache=True)
def _room(
    distance_m: Distances, cell_m: float, x: float, y: float, cos: float, sin: float, corners: FloatArray
) -> tuple[float, float]:
    """Return the radius of a circle around the car about its middle, and the grid's distance there."""
    middle_x, middle_y, around = 0.0, 0.0, 0.0
    count = len(corners)
    for k in range(count):
        middle_x, middle_y = middle_x + corners[k, 0], middle_y + corners[k, 1]
    middle_x, middle_y = middle_x / count, middle_y / count
    for k in range(count):
        dx, dy = corners[k, 0] - middle_x, corners[k, 1] - middle_y
        around = max(around, dx * dx + dy * dy)
    rows, cols = distance_m.shape
    row = min(int((y + sin * middle_x + cos * middle_y) / cell_m), rows - 1)
    col = min(int((x + cos * middle_x - sin * middle_y) / cell_m), cols - 1)
    return math.sqrt(around), distance_m[row, col]


@numba.njit(cache=True)
def separation_m(corners: FloatArray, cos: float, sin: float, dx: float, dy: float, half: float) -> float:
    """Return how far a square, centred (dx, dy) from base_link in the grid's axes, lies outside the side it is most.

    Below 0 where no side separates the two; never more than their distance.
    """
    center_x, center_y = cos * dx + sin * dy, cos * dy - sin * dx
    most = -math.inf
    count = len(corners)
    for k in range(count):
        side_x = corners[(k + 1) % count, 0] - corners[k, 0]
        side_y = corners[(k + 1) % count, 1] - corners[k, 1]
        reach = abs(side_y * cos + side_x * sin) + abs(side_y * sin - side_x * cos)
        apart = side_y * (center_x - corners[k, 0]) - side_x * (center_y - corners[k, 1]) - half * reach
        most = max(most, apart / math.sqrt(side_x * side_x + side_y * side_y))
    return most


@numba.njit(cache=True)
def _distance_to_square_m(corners: FloatArray, cos: float, sin: float, dx: float, dy: float, half: float) -> float:
    """Return the distance in m of the car to a square centred (dx, dy) from base_link; 0 where they touch.

    Of two convex shapes that do not touch, a corner of the one or of the other is nearest.
    """
    low_x, high_x, low_y, high_y = bounds(corners, 0.0, 0.0, cos, sin)
    beside = max(dx - half - high_x, low_x - dx - half, dy - half - high_y, low_y - dy - half)
    if beside <= 0.0 and separation_m(corners, cos, sin, dx, dy, half) <= 0.0:
        return 0.0
    best, count = math.inf, len(corners)
    for k in range(count):
        a_x = cos * corners[k, 0] - sin * corners[k, 1] - dx
        a_y = sin * corners[k, 0] + cos * corners[k, 1] - dy
        best = min(best, math.hypot(max(abs(a_x) - half, 0.0), max(abs(a_y) - half, 0.0)))
        m = (k + 1) % count
        side_x = cos * corners[m, 0] - sin * corners[m, 1] - dx - a_x
        side_y = sin * corners[m, 0] + cos * corners[m, 1] - dy - a_y
        for c in range(4):
            to_x, to_y = half * (1 - 2 * (c & 1)) - a_x, half * (1 - (c & 2)) - a_y
            share = (to_x * side_x + to_y * side_y) / (side_x * side_x + side_y * side_y)
            share = min(max(share, 0.0), 1.0)
            best = min(best, math.hypot(to_x - share * side_x, to_y - share * side_y))
    return best
