"""Where do these points fit best? Exhaustive search over a window of poses by branch and bound on a likelihood field.

Source: Hess, Kohler, Rapp, Andor, "Real-time loop closure in 2D LIDAR SLAM" (ICRA 2016), section V: the score of a
pose is the mean likelihood of the points' cells; a pyramid of running maxima bounds it for whole squares of shifts. The
best pose of the window, to a cell and a step of the angle, is found for certain, as is the best one elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]
Pyramid = NDArray[np.uint8]

_LEVELS = 6
_MARGIN_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodField:
    """Likelihood of a measurement, 0 to 255, around known obstacles.

    pyramid (L, rows, cols): level h holds the maximum over the 2^h x 2^h cells from each cell upwards; origin (2,) is
    the lower-left corner of cell (0, 0) in the field's frame.
    """

    pyramid: Pyramid
    resolution_m: float
    origin: FloatArray


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """Poses around a guess: up to linear_m in x and in y, angular_rad in yaw."""

    linear_m: float
    angular_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Peak:
    """The best pose (3,) of a search, its score 0..1, and the best score elsewhere (0 where it was not looked for)."""

    pose: FloatArray
    score: float
    rival: float


def likelihood_field(
    points: FloatArray, resolution_m: float, sigma_m: float, *, cover: FloatArray | None = None
) -> LikelihoodField:
    """Return the field of obstacle points (N, 2), N >= 1: exp(-d^2 / (2 sigma^2)) of the distance d to the nearest.

    It reaches a margin beyond the points, and beyond those of `cover` (M, 2).
    """
    margin = _MARGIN_M + 3.0 * sigma_m
    extent = points if cover is None else np.vstack([points, cover])
    origin = np.floor((extent.min(axis=0) - margin) / resolution_m) * resolution_m
    cols, rows = (np.ceil((extent.max(axis=0) + margin - origin) / resolution_m).astype(int) + 1).tolist()
    empty = np.full((rows, cols), 255, np.uint8)
    col, row = np.floor((points - origin) / resolution_m).astype(np.int64).T
    empty[row, col] = 0
    distance = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_5) * resolution_m
    field = np.rint(255.0 * np.exp(-0.5 * (distance / sigma_m) ** 2)).astype(np.uint8)
    pyramid = np.empty((_LEVELS, rows, cols), np.uint8)
    pyramid[0] = field
    for level in range(1, _LEVELS):
        step = 1 << (level - 1)
        wide = pyramid[level - 1].copy()
        wide[:, :-step] = np.maximum(wide[:, :-step], pyramid[level - 1][:, step:])
        tall = wide.copy()
        tall[:-step] = np.maximum(tall[:-step], wide[step:])
        pyramid[level] = tall
    return LikelihoodField(pyramid, resolution_m, origin)


def search(
    field: LikelihoodField,
    points: FloatArray,
    guess: FloatArray,
    window: SearchWindow,
    *,
    least_score: float,
    rival_apart_m: float | None = None,
) -> Peak | None:
    """Return the pose (3,) of the points' (N, 2) frame in the field with the best score; None below least_score.

    rival_apart_m: also find the best score of a pose at least so far away, or turned by a tenth of a radian.
    """
    if len(points) == 0:
        return None
    reach = float(np.hypot(points[:, 0], points[:, 1]).max())
    step = field.resolution_m / max(reach, 1.0)
    turns = math.ceil(window.angular_rad / step)
    angles = guess[2] + step * np.arange(-turns, turns + 1)
    cells = math.ceil(window.linear_m / field.resolution_m)
    shift = (guess[:2] - field.origin) / field.resolution_m
    local = points / field.resolution_m
    best = _branch_and_bound(field.pyramid, local, angles, shift, cells, least_score, np.zeros(3), -1.0, 0.0)
    if best[0] < 0.0:
        return None
    pose = _pose_of(best, angles, guess, field.resolution_m)
    rival = 0.0
    if rival_apart_m is not None:
        found = _branch_and_bound(
            field.pyramid, local, angles, shift, cells, 0.5 * best[0],
            np.array(best[1:], dtype=np.float64), rival_apart_m / field.resolution_m, 0.1 / step,
        )  # fmt: skip
        rival = max(found[0], 0.0)
    return Peak(pose, best[0], rival)


def _pose_of(
    best: tuple[float, int, int, int], angles: FloatArray, guess: FloatArray, resolution_m: float
) -> FloatArray:
    _, turn, dx, dy = best
    return np.array([guess[0] + dx * resolution_m, guess[1] + dy * resolution_m, se2.wrap_angle(angles[turn])])


@njit(cache=True, nogil=True)
def _score(pyramid: Pyramid, level: int, cols: NDArray[np.int64], rows: NDArray[np.int64], dx: int, dy: int) -> float:
    """Return the mean value, 0..1, of a level at the shifted cells: a bound for all shifts of the level's square.

    Left of and below the field a square may still reach into it: there the bound is taken at the border.
    """
    height, width = pyramid.shape[1], pyramid.shape[2]
    square = 1 << level
    total = 0
    for n in range(len(cols)):
        col, row = cols[n] + dx, rows[n] + dy
        if col <= -square or row <= -square or col >= width or row >= height:
            continue
        total += pyramid[level, max(row, 0), max(col, 0)]
    return total / (255.0 * len(cols))


@njit(cache=True, nogil=True)
def _turned_cells(
    points: FloatArray, angles: FloatArray, shift: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return columns and rows (A, N) of the points, in cells, after each turn and the shift (2,)."""
    count = points.shape[0]
    cols, rows = np.empty((len(angles), count), np.int64), np.empty((len(angles), count), np.int64)
    for a in range(len(angles)):
        cos, sin = math.cos(angles[a]), math.sin(angles[a])
        for n in range(count):
            cols[a, n] = math.floor(shift[0] + cos * points[n, 0] - sin * points[n, 1])
            rows[a, n] = math.floor(shift[1] + sin * points[n, 0] + cos * points[n, 1])
    return cols, rows


@njit(cache=True, nogil=True)
def _bounds(
    pyramid: Pyramid, top: int, cols: NDArray[np.int64], rows: NDArray[np.int64], cells: int, per_axis: int
) -> FloatArray:
    """Return the bound of each square of the top level that the window needs, by angle, then dx, then dy."""
    side = 1 << top
    bounds = np.empty(len(cols) * per_axis * per_axis)
    for a in range(len(cols)):
        for i in range(per_axis):
            for j in range(per_axis):
                number = (a * per_axis + i) * per_axis + j
                bounds[number] = _score(pyramid, top, cols[a], rows[a], i * side - cells, j * side - cells)
    return bounds


@njit(cache=True, nogil=True)
def _quarter(
    pyramid: Pyramid,
    level: int,
    cols: NDArray[np.int64],
    rows: NDArray[np.int64],
    x: int,
    y: int,
    cells: int,
    bounds: FloatArray,
) -> None:
    """Write the bounds (4,) of the squares of this level that one of the next is made of; -1 beyond the window."""
    half = 1 << level
    for child in range(4):
        dx, dy = x + half * (child % 2), y + half * (child // 2)
        beyond = dx > cells or dy > cells
        bounds[child] = -1.0 if beyond else _score(pyramid, level, cols, rows, dx, dy)


@njit(cache=True, nogil=True)
def _branch_and_bound(
    pyramid: Pyramid,
    points: FloatArray,
    angles: FloatArray,
    shift: FloatArray,
    cells: int,
    least: float,
    taken: FloatArray,
    apart: float,
    turned: float,
) -> tuple[float, int, int, int]:
    """Return (score, number of the angle, dx, dy) of the best shift of up to `cells` each way; score -1 where none.

    apart >= 0: shifts nearer than that to the taken (angle, dx, dy), and turned by less than `turned` steps, are out.
    """
    cols, rows = _turned_cells(points, angles, shift)
    top = pyramid.shape[0] - 1
    while top > 0 and (1 << top) > cells:
        top -= 1
    side = 1 << top
    per_axis = (2 * cells) // side + 1
    bounds = _bounds(pyramid, top, cols, rows, cells, per_axis)
    order = np.argsort(-bounds, kind="mergesort")
    best, best_a, best_x, best_y = least, -1, 0, 0
    stack_score = np.empty(4 * (top + 2))
    stack = np.empty((4 * (top + 2), 3), np.int64)
    child_score = np.empty(4)
    for number in order:
        if bounds[number] <= best:
            break
        a = number // (per_axis * per_axis)
        stack[0, 0] = top
        stack[0, 1], stack[0, 2] = (number // per_axis) % per_axis * side - cells, number % per_axis * side - cells
        stack_score[0] = bounds[number]
        depth = 1
        while depth > 0:
            depth -= 1
            if stack_score[depth] <= best:
                continue
            level, x, y = stack[depth]
            if level == 0:
                if apart >= 0.0 and abs(a - taken[0]) < turned and math.hypot(x - taken[1], y - taken[2]) < apart:
                    continue
                best, best_a, best_x, best_y = stack_score[depth], a, x, y
                continue
            half = 1 << (level - 1)
            _quarter(pyramid, level - 1, cols[a], rows[a], x, y, cells, child_score)
            for child in np.argsort(child_score):
                if child_score[child] > best:
                    stack_score[depth] = child_score[child]
                    stack[depth, 0] = level - 1
                    stack[depth, 1], stack[depth, 2] = x + half * (child % 2), y + half * (child // 2)
                    depth += 1
    if best_a < 0:
        return -1.0, -1, 0, 0
    return best, best_a, best_x, best_y
