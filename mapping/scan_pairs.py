"""Two keyframes against each other: which samples lie on the other's walls, and the pull towards them.

The samples of one keyframe, moved into the other's frame, are paired with the nearest sample there; the distance from
that sample's line is the residual (point-to-line, Censi 2008). The nearest sample is found by walking outwards in
angle around the sensor, which stops as soon as no nearer one can follow. Compiled by numba, free of the GIL.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]

_SAME_SIDE = 0.5  # cosine between two normals of one wall: its two sides are different walls


@njit(cache=True, nogil=True)
def nearest_sample(
    points: Float32Array,
    angles: Float32Array,
    first: int,
    last: int,
    x: float,
    y: float,
    sensor: FloatArray,
    limit: float,
) -> tuple[int, float]:
    """Return the index, in [first, last), of the sample nearest to (x, y) and its distance; -1 beyond the limit (m)."""
    best, best_index = limit * limit, -1
    count = last - first
    if count == 0:
        return -1, limit
    dx, dy = x - sensor[0], y - sensor[1]
    distance = math.sqrt(dx * dx + dy * dy)
    angle = math.atan2(dy, dx)
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if angles[middle] < angle:
            low = middle + 1
        else:
            high = middle
    start = low - first
    for direction in (1, -1):
        for step in range(count):
            offset = start + step if direction == 1 else start - 1 - step
            index = first + offset % count
            gap = abs(angles[index] - angle)
            if gap > math.pi:
                gap = 2.0 * math.pi - gap
            if gap < 0.5 * math.pi:
                across = distance * gap * (1.0 - gap * gap / 6.0)  # sin(gap) is no smaller
                if across * across > best:
                    break
            elif distance * distance > best:
                break
            ex, ey = points[index, 0] - x, points[index, 1] - y
            squared = ex * ex + ey * ey
            if squared < best:
                best, best_index = squared, index
    return best_index, math.sqrt(best)


@njit(cache=True, nogil=True)
def pull(
    own_points: Float32Array,
    own_normals: Float32Array,
    own_reaches: Float32Array,
    own_first: int,
    own_last: int,
    points: Float32Array,
    angles: Float32Array,
    normals: Float32Array,
    levels: Float32Array,
    reaches: Float32Array,
    first: int,
    last: int,
    sensor: FloatArray,
    moving_pose: FloatArray,
    fixed_pose: FloatArray,
    gate: float,
    scale: float,
    stride: int,
    hessian: FloatArray,
    gradient: FloatArray,
) -> tuple[int, float]:
    """Add the normal equations of one scan's own samples on another's walls; return pairs and weighted sum of e^2.

    own_* hold the moving scan in [own_first, own_last), the others the fixed one in [first, last), see Surface. Poses
    (3,) are of both bodies in one frame. hessian (6, 6), of which the upper half is filled, and gradient (6,) are those
    of sum w e^2 / 2 over (x, y, yaw) of moving, then of fixed; w is Geman-McClure's 1 / (1 + (e / scale)^2)^2. Pairs
    with |e| > gate and those farther along the wall than it is known are left out. Every stride-th sample is used.
    """
    cos_m, sin_m = math.cos(moving_pose[2]), math.sin(moving_pose[2])
    cos_f, sin_f = math.cos(fixed_pose[2]), math.sin(fixed_pose[2])
    pairs, cost = 0, 0.0
    row = np.empty(6)
    for index in range(own_first, own_last, stride):
        turned_x = cos_m * own_points[index, 0] - sin_m * own_points[index, 1]
        turned_y = sin_m * own_points[index, 0] + cos_m * own_points[index, 1]
        rel_x, rel_y = turned_x + moving_pose[0] - fixed_pose[0], turned_y + moving_pose[1] - fixed_pose[1]
        x, y = cos_f * rel_x + sin_f * rel_y, -sin_f * rel_x + cos_f * rel_y
        near, _ = nearest_sample(points, angles, first, last, x, y, sensor, max(gate, 0.4))
        if near < 0 or reaches[near] == 0.0:
            continue
        nx, ny = normals[near, 0], normals[near, 1]
        error = nx * x + ny * y - levels[near]
        if abs(error) > gate:
            continue
        along = -ny * (x - points[near, 0]) + nx * (y - points[near, 1])
        if abs(along) > reaches[near]:
            continue
        world_nx, world_ny = cos_f * nx - sin_f * ny, sin_f * nx + cos_f * ny
        own_x = cos_m * own_normals[index, 0] - sin_m * own_normals[index, 1]
        own_y = sin_m * own_normals[index, 0] + cos_m * own_normals[index, 1]
        if own_reaches[index] > 0.0 and own_x * world_nx + own_y * world_ny < _SAME_SIDE:
            continue
        root = 1.0 / (1.0 + (error / scale) ** 2)
        weight = root * root
        row[0], row[1] = world_nx, world_ny
        row[2] = -world_nx * turned_y + world_ny * turned_x
        row[3], row[4] = -world_nx, -world_ny
        row[5] = world_nx * rel_y - world_ny * rel_x
        for a in range(6):
            gradient[a] += weight * row[a] * error
            for b in range(a, 6):
                hessian[a, b] += weight * row[a] * row[b]
        pairs += 1
        cost += weight * error * error
    return pairs, cost


@njit(cache=True, nogil=True)
def agreement(
    points: Float32Array,
    angles: Float32Array,
    ranges: Float32Array,
    starts: IndexArray,
    sensor: FloatArray,
    moving: int,
    fixed: int,
    T_fixed_moving: FloatArray,
    tolerance: float,
    stride: int,
) -> tuple[int, int, int]:
    """Return how many of `moving`'s samples lie on a sample of `fixed` (hits), stand where it saw through, are hidden.

    tolerance in m grows with the range as 1 % of it. What is neither hit, nor conflict, nor hidden behind what fixed
    saw, is outside its field of view or counts as hidden.
    """
    cos, sin = math.cos(T_fixed_moving[2]), math.sin(T_fixed_moving[2])
    first, last = starts[fixed], starts[fixed + 1]
    count = last - first
    hits, conflicts, hidden = 0, 0, 0
    if count < 2:
        return 0, 0, 0
    spacing = 4.0 * (angles[last - 1] - angles[first]) / count
    for index in range(starts[moving], starts[moving + 1], stride):
        x = T_fixed_moving[0] + cos * points[index, 0] - sin * points[index, 1]
        y = T_fixed_moving[1] + sin * points[index, 0] + cos * points[index, 1]
        dx, dy = x - sensor[0], y - sensor[1]
        distance, angle = math.hypot(dx, dy), math.atan2(dy, dx)
        allowed = tolerance + 0.01 * distance
        near, _ = nearest_sample(points, angles, first, last, x, y, sensor, allowed)
        if near >= 0:
            hits += 1
            continue
        low, high = first, last
        while low < high:
            middle = (low + high) // 2
            if angles[middle] < angle:
                low = middle + 1
            else:
                high = middle
        after = first + (low - first) % count
        before = first + (low - first - 1) % count
        gap_after, gap_before = abs(angles[after] - angle), abs(angle - angles[before])
        gap_after, gap_before = min(gap_after, 2.0 * math.pi - gap_after), min(gap_before, 2.0 * math.pi - gap_before)
        if gap_after > spacing or gap_before > spacing:
            hidden += 1  # no ray went there
        elif distance < min(ranges[after], ranges[before]) - 2.0 * allowed:
            conflicts += 1
        else:
            hidden += 1
    return hits, conflicts, hidden


@njit(cache=True, nogil=True)
def pull_pairs(
    points: Float32Array,
    angles: Float32Array,
    normals: Float32Array,
    levels: Float32Array,
    reaches: Float32Array,
    starts: IndexArray,
    sensor: FloatArray,
    moving: IndexArray,
    fixed: IndexArray,
    moving_poses: FloatArray,
    fixed_poses: FloatArray,
    gate: float,
    scale: float,
    stride: int,
) -> tuple[FloatArray, FloatArray, IndexArray, FloatArray]:
    """Return hessians (P, 6, 6), gradients (P, 6), paired samples (P,) and costs (P,) of P pairs, see `pull`."""
    count = len(moving)
    hessians, gradients = np.zeros((count, 6, 6)), np.zeros((count, 6))
    numbers, costs = np.zeros(count, np.int64), np.zeros(count)
    for p in range(count):
        numbers[p], costs[p] = pull(
            points, normals, reaches, starts[moving[p]], starts[moving[p] + 1],
            points, angles, normals, levels, reaches, starts[fixed[p]], starts[fixed[p] + 1], sensor,
            moving_poses[p], fixed_poses[p], gate, scale, stride, hessians[p], gradients[p],
        )  # fmt: skip
        for a in range(6):
            for b in range(a):
                hessians[p, a, b] = hessians[p, b, a]
    return hessians, gradients, numbers, costs


@njit(cache=True, nogil=True)
def agreement_of_pairs(
    points: Float32Array,
    angles: Float32Array,
    ranges: Float32Array,
    starts: IndexArray,
    sensor: FloatArray,
    moving: IndexArray,
    fixed: IndexArray,
    T_fixed_moving: FloatArray,
    tolerance: float,
    stride: int,
) -> IndexArray:
    """Return hits, conflicts and hidden samples (3,) summed over P pairs at relative poses (P, 3), see `agreement`."""
    total = np.zeros(3, np.int64)
    for p in range(len(moving)):
        hits, conflicts, hidden = agreement(
            points, angles, ranges, starts, sensor, moving[p], fixed[p], T_fixed_moving[p], tolerance, stride
        )
        total[0] += hits
        total[1] += conflicts
        total[2] += hidden
    return total
