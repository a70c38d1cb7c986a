"""What speaks for and against a pose of one map on another: metres of wall that agree, contradict, or say nothing.

Ratios alone do not tell a right pose from a wrong one that overlaps by little; metres of agreeing wall do. They are
counted at three tolerances, so that warped maps are judged by the widest and sharp ones by the narrowest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.outline import Outline
from mapping.wall_map import FREE, UNKNOWN, WALL, Distances, States, WallMap

FloatArray = NDArray[np.float64]
TOLERANCES_M = (0.12, 0.25, 0.50)
VIOLATIONS_M = (0.30, 0.60, 1.20)  # a wall so far from all others, in free space, contradicts
_TOLERANCE_CELLS, _VIOLATION_CELLS = 1.5, 3.0
_PARALLEL = math.cos(math.radians(30.0))
_BLOCK_M = 2.0
_BLOCK_LEAST_M = 0.5
_BLOCK_AGREES, _BLOCK_FAILS = 0.7, 0.3
_LINE_RAD, _LINE_M = math.radians(15.0), 0.5  # walls so much alike in direction and place are one line
_LINE_LEAST_M = 0.75
_NEAR_KNOWN = 3
_COUNTS = 27


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A map to judge against: like its states, with NEAR_KNOWN for unknown cells beside known ones, and directions.

    directions (rows, cols): normal of the nearest outline point, in 1/254 of half a turn; 255 where it has none.
    """

    walls: WallMap
    seen: States
    directions: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """Points (N, 2) of a map's outline to try on the other, their lengths (N,) in m and normals (N, 2).

    blocks, lines (N,): number of the 2 m block that a point is in, and of the straight line that it is part of, -1 for
    none.
    """

    points: FloatArray
    lengths: FloatArray
    normals: FloatArray
    blocks: NDArray[np.int64]
    lines: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Agreements:
    """Metres of the probe's wall at K poses.

    known (K,) on cells that the other map knows; hits, conflicts (K, 3) at the three tolerances; parallel (K, 2) of the
    hits at the two narrower tolerances run along the other map's wall; crossing (K,) run across it; weak, strong (K,):
    metres of parallel wall, by how well they hold the pose in its least and its best held direction; turning (K,): how
    well they hold the angle, in m^3; good, bad (K,): blocks of 2 m that agree and that contradict. hit_gap (K,): rms
    distance in m of the hits at the middle tolerance. worst (K, 2): metres in the block that contradicts most, at the
    middle and the wide tolerance; against (K, 2): contradicting metres of straight wall alone; good_lines, bad_lines
    (K,): straight lines that agree and that contradict; variety (K,): over how many lines the agreeing wall is spread
    (exponential of the entropy); rough (K,): agreeing metres without a direction, of corners and furniture.
    """

    known: FloatArray
    hits: FloatArray
    conflicts: FloatArray
    parallel: FloatArray
    crossing: FloatArray
    weak: FloatArray
    strong: FloatArray
    weak_direction: FloatArray
    turning: FloatArray
    good: FloatArray
    bad: FloatArray
    hit_gap: FloatArray
    worst: FloatArray
    against: FloatArray
    good_lines: FloatArray
    bad_lines: FloatArray
    variety: FloatArray
    rough: FloatArray


def surface_of(walls: WallMap, outline: Outline) -> Surface:
    """Make a map ready to be judged against."""
    known = (walls.states != UNKNOWN).astype(np.uint8)
    grown = cv2.dilate(known, np.ones((3, 3), np.uint8))
    seen = np.where((grown > 0) & (known == 0), np.uint8(_NEAR_KNOWN), walls.states)
    directions = np.full(walls.states.shape, 255, np.uint8)
    if len(outline.points):
        cols, rows = np.floor(outline.points / walls.resolution_m).astype(np.intp).T
        empty = np.ones(walls.states.shape, np.uint8)
        empty[rows, cols] = 0
        _, labels = cv2.distanceTransformWithLabels(
            empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
        )
        codes = np.full(int(labels.max()) + 1, 255, np.uint8)
        codes[labels[rows, cols]] = _direction_codes(outline.normals)
        directions = codes[labels]
    return Surface(walls, np.asarray(seen, dtype=np.uint8), directions)


def probe_of(outline: Outline, most: int) -> Probe:
    """Return up to `most` points spread evenly over an outline, which stand for all of its wall."""
    count = len(outline.points)
    chosen = np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)
    lengths = outline.lengths[chosen] * (outline.lengths.sum() / max(outline.lengths[chosen].sum(), 1e-9))
    squares = np.floor(outline.points[chosen] / _BLOCK_M).astype(np.int64)
    _, blocks = np.unique(squares, axis=0, return_inverse=True)
    points, normals = outline.points[chosen], outline.normals[chosen]
    return Probe(points, lengths, normals, blocks.reshape(-1).astype(np.int64), _lines_of(points, normals))


def judge_poses(surface: Surface, probe: Probe, poses: FloatArray, least_cell_m: float) -> Agreements:
    """Count the probe's wall on the surface at poses (K, 3) of its grid; least_cell_m: cell of the coarser map."""
    tolerances = np.maximum(TOLERANCES_M, _TOLERANCE_CELLS * least_cell_m)
    violations = np.maximum(VIOLATIONS_M, _VIOLATION_CELLS * least_cell_m)
    blocks, lines = (int(each.max(initial=-1)) + 1 for each in (probe.blocks, probe.lines))
    counts = np.zeros((len(poses), _COUNTS))
    walls = surface.walls
    _count_all(
        walls.distances, surface.seen, surface.directions, walls.resolution_m, probe.points, probe.lengths,
        probe.normals, probe.blocks, blocks, probe.lines, lines, np.ascontiguousarray(poses), tolerances, violations,
        counts,
    )  # fmt: skip
    half_sum, half_gap = 0.5 * (counts[:, 10] + counts[:, 12]), 0.5 * (counts[:, 10] - counts[:, 12])
    spread = np.hypot(half_gap, counts[:, 11])
    weak_direction = 0.5 * np.arctan2(2.0 * counts[:, 11], counts[:, 10] - counts[:, 12]) + 0.5 * np.pi
    return Agreements(
        known=counts[:, 0],
        hits=counts[:, 1:4],
        conflicts=counts[:, 4:7],
        parallel=counts[:, 7:9],
        crossing=counts[:, 9],
        weak=np.maximum(half_sum - spread, 0.0),
        strong=half_sum + spread,
        weak_direction=weak_direction,
        turning=_turning(counts),
        good=counts[:, 14],
        bad=counts[:, 15],
        hit_gap=np.sqrt(counts[:, 16] / np.maximum(counts[:, 2], 1e-9)),
        worst=counts[:, 19:21],
        against=counts[:, 21:23],
        good_lines=counts[:, 23],
        bad_lines=counts[:, 24],
        variety=np.exp(counts[:, 25]),
        rough=counts[:, 26],
    )


def compare_cells(
    surface: Surface, cells: FloatArray, states: States, area_m2: float, poses: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the areas in m^2 (K,) where cells (N, 2) of the other map, each of area_m2, are free on free, wall on wall
    and one on the other, at poses (K, 3).
    """
    counts = np.zeros((len(poses), 3))
    walls = surface.walls
    _compare_all(walls.states, walls.resolution_m, cells, states, np.ascontiguousarray(poses), counts)
    counts *= area_m2
    return counts[:, 0], counts[:, 1], counts[:, 2]


def _lines_of(points: FloatArray, normals: FloatArray) -> NDArray[np.int64]:
    """Return the number of the straight line (N,) that points with a normal belong to, by direction and distance."""
    angle = np.arctan2(normals[:, 1], normals[:, 0])
    turned = np.where(angle < 0.0, -1.0, 1.0)[:, np.newaxis]  # a line has no side
    direction = np.floor((angle % np.pi) / _LINE_RAD)
    middle = points.mean(axis=0) if len(points) else np.zeros(2)
    place = np.floor(((points - middle) * normals * turned).sum(axis=1) / _LINE_M)
    straight = (normals != 0.0).any(axis=1)
    _, numbers = np.unique(np.column_stack([direction, place])[straight], axis=0, return_inverse=True)
    lines = np.full(len(points), -1, np.int64)
    lines[straight] = numbers.reshape(-1)
    return lines


def _turning(counts: FloatArray) -> FloatArray:
    """Return how well parallel walls hold the angle (K,), in m^3, whatever the shift."""
    xx, xy, yy = counts[:, 10] + 1e-6, counts[:, 11], counts[:, 12] + 1e-6
    x, y = counts[:, 17], counts[:, 18]
    explained = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / np.maximum(xx * yy - xy * xy, 1e-9)
    return np.maximum(counts[:, 13] - explained, 0.0)


def _direction_codes(normals: FloatArray) -> NDArray[np.uint8]:
    """Return the directions (N,) of normals (N, 2), without their sign, as in Surface."""
    angle = np.arctan2(normals[:, 1], normals[:, 0]) % np.pi
    codes = np.minimum(np.rint(angle * (254.0 / np.pi)), 254.0).astype(np.uint8)
    return np.where((normals == 0.0).all(axis=1), np.uint8(255), codes)


@njit(cache=True, nogil=True)
def _count_all(
    distances: Distances,
    seen: States,
    directions: NDArray[np.uint8],
    resolution_m: float,
    points: FloatArray,
    lengths: FloatArray,
    normals: FloatArray,
    blocks: NDArray[np.int64],
    block_count: int,
    lines: NDArray[np.int64],
    line_count: int,
    poses: FloatArray,
    tolerances: FloatArray,
    violations: FloatArray,
    counts: FloatArray,
) -> None:
    """Fill counts (K, _COUNTS), see judge_poses; block sums are kept for one pose at a time."""
    rows, cols = distances.shape
    agreeing, contradicting, far_off = np.zeros(block_count), np.zeros(block_count), np.zeros(block_count)
    line_agreeing, line_contradicting = np.zeros(line_count), np.zeros(line_count)
    cosines, sines = np.empty(255), np.empty(255)
    for n in range(255):
        cosines[n], sines[n] = math.cos(n * math.pi / 254.0), math.sin(n * math.pi / 254.0)
    for k in range(poses.shape[0]):
        count = counts[k]
        agreeing[:], contradicting[:], far_off[:] = 0.0, 0.0, 0.0
        line_agreeing[:], line_contradicting[:] = 0.0, 0.0
        cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for n in range(points.shape[0]):
            x = poses[k, 0] + cos * points[n, 0] - sin * points[n, 1]
            y = poses[k, 1] + sin * points[n, 0] + cos * points[n, 1]
            col, row = math.floor(x / resolution_m), math.floor(y / resolution_m)
            if col < 0 or row < 0 or col >= cols or row >= rows or seen[row, col] == UNKNOWN:
                continue
            length, d = lengths[n], distances[row, col]
            count[0] += length
            for level in range(3):
                if d <= tolerances[level]:
                    count[1 + level] += length
                elif d > violations[level] and seen[row, col] == FREE:
                    count[4 + level] += length
            if d > violations[1] and seen[row, col] == FREE:
                contradicting[blocks[n]] += length
                if lines[n] >= 0:
                    line_contradicting[lines[n]] += length
                    count[21] += length
                if d > violations[2]:
                    far_off[blocks[n]] += length
                    if lines[n] >= 0:
                        count[22] += length
            if d > tolerances[1]:
                continue
            count[16] += length * d * d
            code = directions[row, col]
            nx, ny = cos * normals[n, 0] - sin * normals[n, 1], sin * normals[n, 0] + cos * normals[n, 1]
            if code == 255 or (nx == 0.0 and ny == 0.0):
                agreeing[blocks[n]] += length
                if d <= tolerances[0]:
                    count[26] += length
                continue
            across = abs(nx * cosines[code] + ny * sines[code])
            if across < 0.5:
                count[9] += length
                continue
            agreeing[blocks[n]] += length
            if across < _PARALLEL:
                continue
            count[8] += length
            if lines[n] >= 0:
                line_agreeing[lines[n]] += length
            if d <= tolerances[0]:
                count[7] += length
            count[10] += length * nx * nx
            count[11] += length * nx * ny
            count[12] += length * ny * ny
            turn = ny * x - nx * y
            count[13] += length * turn * turn
            count[17] += length * turn * nx
            count[18] += length * turn * ny
        total = line_agreeing.sum()
        for n in range(line_count):
            if line_agreeing[n] >= _LINE_LEAST_M and line_agreeing[n] > line_contradicting[n]:
                count[23] += 1.0
            elif line_contradicting[n] >= _LINE_LEAST_M:
                count[24] += 1.0
            if line_agreeing[n] > 0.0:
                count[25] -= line_agreeing[n] / total * math.log(line_agreeing[n] / total)
        for n in range(block_count):
            count[19] = max(count[19], contradicting[n])
            count[20] = max(count[20], far_off[n])
            judged = agreeing[n] + contradicting[n]
            if judged >= _BLOCK_LEAST_M:
                if agreeing[n] >= _BLOCK_AGREES * judged:
                    count[14] += 1.0
                elif agreeing[n] <= _BLOCK_FAILS * judged:
                    count[15] += 1.0


@njit(cache=True, nogil=True)
def _compare_all(
    states: States, resolution_m: float, cells: FloatArray, own: States, poses: FloatArray, counts: FloatArray
) -> None:
    """Fill counts (K, 3): free on free, wall on wall, one on the other."""
    rows, cols = states.shape
    for k in range(poses.shape[0]):
        cos, sin = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        for n in range(cells.shape[0]):
            x = poses[k, 0] + cos * cells[n, 0] - sin * cells[n, 1]
            y = poses[k, 1] + sin * cells[n, 0] + cos * cells[n, 1]
            col, row = math.floor(x / resolution_m), math.floor(y / resolution_m)
            if col < 0 or row < 0 or col >= cols or row >= rows or states[row, col] == UNKNOWN:
                continue
            if states[row, col] == own[n]:
                counts[k, 0 if own[n] == FREE else 1] += 1.0
            else:
                counts[k, 2] += 1.0
