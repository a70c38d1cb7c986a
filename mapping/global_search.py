"""Where on a whole map do these points fit best? Exhaustive search over all poses and headings on a likelihood field.

The branch and bound of `correlation`, made for whole maps: the bounds of all squares of 4 x 4 shifts are summed up row
by row (what a processor does fastest), and only squares whose bound beats the best place so far are looked into.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping import se2
from mapping.correlation import LikelihoodField, Peak

FloatArray = NDArray[np.float64]
Pyramid = NDArray[np.uint8]
IndexArray = NDArray[np.int32]

_DENSE_LEVEL = 2  # bounds for squares of 4 x 4 shifts first
_PUSHED = 1 << 40  # above every sum
MOST_POINTS_EVERYWHERE = 257  # their sum of 0..255 each still fits 16 bits


def search_everywhere(
    field: LikelihoodField,
    points: FloatArray,
    *,
    least_score: float,
    least_share: float,
    most: int,
    apart_m: float,
    apart_rad: float,
    where: NDArray[np.bool_] | None = None,
) -> list[Peak]:
    """Return the best pose of the points' (N, 2) frame over the whole field and every yaw, and the best ones elsewhere.

    Up to `most` peaks, best first, whose scores reach least_score and least_share of the first one's. Each is the best
    of all poses whose origin is in the middle of a cell of `where` (rows, cols; None: anywhere in the field), and that
    are more than apart_m (in x or in y) or apart_rad from all peaks before; its rival is the next one's score. A step
    of the angle moves a point at the root mean square range by a cell. Ties go to the pose that is looked at first.
    Raises ValueError for more points than MOST_POINTS_EVERYWHERE.
    """
    if len(points) > MOST_POINTS_EVERYWHERE:
        raise ValueError(f"{len(points)} points, a search everywhere takes at most {MOST_POINTS_EVERYWHERE}")
    if len(points) == 0:
        return []
    local: FloatArray = np.asarray(points / field.resolution_m, dtype=np.float64)
    turns = math.ceil(2.0 * np.pi * max(math.sqrt(float(np.square(local).sum(axis=1).mean())), 1.0))
    angles: FloatArray = np.arange(turns, dtype=np.float64) * (2.0 * np.pi / turns)
    cols, rows = _turned_cells(_strewn(local), angles)
    shape = field.pyramid.shape[1:]
    allowed = np.ones(shape, np.bool_) if where is None else np.ascontiguousarray(where)
    least = math.ceil(least_score * 255.0 * len(points)) - 1
    bounds, blocks = _dense_bounds(_by_phase(field.pyramid[_DENSE_LEVEL]), cols, rows, _any_in_square(allowed), least)
    order = np.argsort(np.iinfo(np.uint16).max - bounds, kind="stable")
    bounds, blocks = bounds[order], blocks[order]
    taken = np.zeros((0, 3), dtype=np.int64)
    apart = np.array([math.floor(apart_rad * turns / (2.0 * np.pi)), math.floor(apart_m / field.resolution_m)])
    found: list[tuple[int, int, int, int]] = []
    for _ in range(most):
        best = _best_elsewhere(field.pyramid, allowed, cols, rows, bounds, blocks, least, taken, apart)
        if best[0] < 0:
            break
        if not found:
            least = max(least, math.ceil(least_share * best[0]) - 1)
        found.append(best)
        taken = np.vstack([taken, np.array(best[1:])])
    scores = [total / (255.0 * len(points)) for total, *_ in found]
    return [
        Peak(
            np.array([*(field.origin + (np.array([dx, dy]) + 0.5) * field.resolution_m), se2.wrap_angle(angles[turn])]),
            score,
            rival,
        )
        for (_, turn, dx, dy), score, rival in zip(found, scores, [*scores, 0.0][1:], strict=True)
    ]


@njit(cache=True, nogil=True)
def _turned_cells(points: FloatArray, angles: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return the columns and rows (A, N) of points (N, 2), in cells, turned about the middle of cell (0, 0)."""
    cols, rows = np.empty((len(angles), len(points)), np.int32), np.empty((len(angles), len(points)), np.int32)
    for a in range(len(angles)):
        cos, sin = math.cos(angles[a]), math.sin(angles[a])
        for n in range(len(points)):
            cols[a, n] = math.floor(0.5 + cos * points[n, 0] - sin * points[n, 1])
            rows[a, n] = math.floor(0.5 + sin * points[n, 0] + cos * points[n, 1])
    return cols, rows


def _by_phase(level: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the dense level's cells sorted by their place in squares of side x side: (side, side, R, C).

    [i, j, r, c] is the cell (side (r - 1) + i, side (c - 1) + j). Squares that reach into the field from below or from
    the left hold the bound at the border.
    """
    side = 1 << _DENSE_LEVEL
    rows, cols = level.shape
    padded = np.zeros(((rows + side - 1) // side * side + side, (cols + side - 1) // side * side + side), np.uint8)
    padded[side : side + rows, side : side + cols] = level
    padded[:side, side : side + cols] = level[0]
    padded[side : side + rows, :side] = level[:, :1]
    padded[:side, :side] = level[0, 0]
    height, width = padded.shape
    split = padded.reshape(height // side, side, width // side, side)
    return np.ascontiguousarray(split.transpose(1, 3, 0, 2))


def _any_in_square(allowed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (I, J): whether a square of cells holds an allowed one."""
    side = 1 << _DENSE_LEVEL
    rows, cols = allowed.shape
    padded = np.pad(allowed, ((0, -rows % side), (0, -cols % side)))
    return np.asarray(padded.reshape(-(-rows // side), side, -(-cols // side), side).any(axis=(1, 3)))


@njit(cache=True, nogil=True)
def _dense_bounds(
    phases: NDArray[np.uint8], cols: IndexArray, rows: IndexArray, squares: NDArray[np.bool_], least: int
) -> tuple[NDArray[np.uint16], IndexArray]:
    """Return the sums (M,) that bound squares of shifts, those above `least`, and their (M, 3) angle, row and column.

    squares (I, J): which to look at. The sums of a whole row of squares grow at once: that is what makes it fast.
    """
    side = phases.shape[0]
    height, width = squares.shape
    sums = np.zeros((height, width), np.uint16)
    bounds, blocks = np.empty(4096, np.uint16), np.empty((4096, 3), np.int32)
    count = 0
    for a in range(cols.shape[0]):
        sums[:] = 0
        for n in range(cols.shape[1]):
            row, col = rows[a, n] // side + 1, cols[a, n] // side + 1
            values = phases[rows[a, n] % side, cols[a, n] % side]
            first, last = max(0, -col), min(width, values.shape[1] - col)
            if first >= last:
                continue
            for i in range(max(0, -row), min(height, values.shape[0] - row)):
                target, source = sums[i, first:last], values[row + i, col + first : col + last]
                for j in range(last - first):
                    target[j] += source[j]
        for i in range(height):
            for j in range(width):
                if sums[i, j] <= least or not squares[i, j]:
                    continue
                if count == len(bounds):
                    bounds, blocks = np.append(bounds, bounds), np.concatenate((blocks, blocks))
                bounds[count] = sums[i, j]
                blocks[count, 0], blocks[count, 1], blocks[count, 2] = a, i, j
                count += 1
    return bounds[:count], blocks[:count]


def _strewn(points: FloatArray) -> FloatArray:
    """Return the points in an order in which neighbours come far apart: a sum then soon shows that it stays low."""
    stride = max(1, round(len(points) * 0.381966))
    while math.gcd(stride, len(points)) != 1:
        stride += 1
    return np.ascontiguousarray(points[np.arange(len(points)) * stride % len(points)])


@njit(cache=True, nogil=True)
def _sum_over(
    pyramid: Pyramid, level: int, cols: NDArray[np.int32], rows: NDArray[np.int32], dx: int, dy: int, least: int
) -> int:
    """Return the sum of a level at the shifted cells, like `_score`; -1 as soon as it cannot exceed `least`."""
    height, width = pyramid.shape[1], pyramid.shape[2]
    square = 1 << level
    total, spare = 0, 255 * len(cols) - least
    for n in range(len(cols)):
        col, row = cols[n] + dx, rows[n] + dy
        value = 0
        if col > -square and row > -square and col < width and row < height:
            value = int(pyramid[level, max(row, 0), max(col, 0)])
        total += value
        spare -= 255 - value
        if spare <= 0:
            return -1
    return total


@njit(cache=True, nogil=True)
def _is_taken(
    taken: NDArray[np.int64], apart: NDArray[np.int64], turns: int, a: int, x: int, y: int, side: int
) -> bool:
    """Whether a whole square of shifts lies near a taken (angle, x, y)."""
    for n in range(taken.shape[0]):
        turned = abs(a - taken[n, 0])
        if min(turned, turns - turned) > apart[0]:
            continue
        far_x = max(abs(x - taken[n, 1]), abs(x + side - 1 - taken[n, 1]))
        far_y = max(abs(y - taken[n, 2]), abs(y + side - 1 - taken[n, 2]))
        if far_x <= apart[1] and far_y <= apart[1]:
            return True
    return False


@njit(cache=True, nogil=True)
def _best_elsewhere(
    pyramid: Pyramid,
    allowed: NDArray[np.bool_],
    cols: IndexArray,
    rows: IndexArray,
    bounds: NDArray[np.uint16],
    blocks: IndexArray,
    least: int,
    taken: NDArray[np.int64],
    apart: NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """Return (sum, angle, x, y) of the best shift above `least` that is not near a taken one; sum -1 where none is.

    bounds (M,) falling, with blocks (M, 3): see `_dense_bounds`.
    """
    turns, top = cols.shape[0], _DENSE_LEVEL
    best, best_a, best_x, best_y = least, -1, 0, 0
    stack = np.empty((4 * (top + 2), 4), np.int64)
    child = np.empty((4, 4), np.int64)
    for block in range(len(bounds)):
        if bounds[block] <= best:
            break
        a = blocks[block, 0]
        stack[0, 0], stack[0, 1] = bounds[block], top
        stack[0, 2], stack[0, 3] = blocks[block, 2] << top, blocks[block, 1] << top
        depth = 1
        while depth > 0:
            depth -= 1
            bound, level, x, y = stack[depth]
            if bound <= best or _is_taken(taken, apart, turns, a, x, y, 1 << level):
                continue
            if level == 0:
                if allowed[y, x]:
                    best, best_a, best_x, best_y = bound, a, x, y
                continue
            half = 1 << (level - 1)
            for n in range(4):
                cx, cy = x + half * (n % 2), y + half * (n // 2)
                total = -1
                if cx < pyramid.shape[2] and cy < pyramid.shape[1]:
                    total = _sum_over(pyramid, level - 1, cols[a], rows[a], cx, cy, best)
                child[n, 0], child[n, 1], child[n, 2], child[n, 3] = total, level - 1, cx, cy
            for _ in range(4):  # the most promising one on top
                least_n = 0
                for n in range(1, 4):
                    if child[n, 0] < child[least_n, 0]:
                        least_n = n
                if best < child[least_n, 0] < _PUSHED:
                    stack[depth] = child[least_n]
                    depth += 1
                child[least_n, 0] = _PUSHED
    if best_a < 0:
        return -1, -1, 0, 0
    return best, best_a, best_x, best_y
