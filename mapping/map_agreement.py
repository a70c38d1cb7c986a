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
from mapping.wall_map import FREE, UNKNOWN, Distances, States, WallMap

FloatArray = NDArray[np.float64]
TOLERANCES_M = (0.12, 0.25, 0.50)
VIOLATIONS_M = (0.30, 0.60, 1.20)  # a wall so far from all others, in free space, contradicts
_TOLERANCE_CELLS, _VIOLATION_CELLS = 1.5, 3.0
_PARALLEL, _CROSSING = math.cos(math.radians(30.0)), math.cos(math.radians(60.0))
_BLOCK_M = 2.0
_BLOCK_LEAST_M = 0.5
_BLOCK_AGREES, _BLOCK_FAILS = 0.7, 0.3
_LINE_RAD, _LINE_M = math.radians(15.0), 0.5  # walls so much alike in direction and place are one line
_LINE_LEAST_M = 0.75
_NEAR_KNOWN = 3
_CODES = 127  # directions are told apart by so many


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A map to judge against: like its states, with NEAR_KNOWN for unknown cells beside known ones, and directions.

    directions (rows, cols): normal of the nearest outline point; 0 to 126 in 1/127 of a turn where its open side is
    known, 127 to 253 in 1/127 of half a turn where it is not, 255 where it has none.
    """

    walls: WallMap
    seen: States
    directions: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """Points (N, 2) of a map's outline to try on the other, their lengths (N,) in m and normals (N, 2), see Outline.

    faced (N,): the normal points to the wall's open side. blocks, lines (N,): number of the 2 m block that a point is
    in, and of the straight line that it is part of, -1 for none.
    """

    points: FloatArray
    lengths: FloatArray
    normals: FloatArray
    faced: NDArray[np.bool_]
    blocks: NDArray[np.int64]
    lines: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Agreements:
    """Metres of the probe's wall at K poses.

    known (K,) on cells that the other map knows; hits, conflicts (K, 3) at the three tolerances; parallel (K, 2) of the
    hits at the two narrower tolerances run along the other map's wall; crossing (K,) run across it; weak, strong (K,):
    metres of parallel wall, by how well they hold the pose in its least and its best held direction; weak_direction
    (K,): the former, in rad in the surface's frame; turning (K,): how well they hold the angle, in m^3; good, bad (K,):
    blocks of 2 m that agree and that contradict. hit_gap (K,): rms distance in m of the hits at the middle tolerance.
    worst (K, 2): metres in the block that contradicts most, at the middle and the wide tolerance; against (K, 2):
    contradicting metres of straight wall alone; good_lines, bad_lines (K,): straight lines that agree and that
    contradict; variety (K,): over how many lines the agreeing wall is spread (exponential of the entropy); rough (K,):
    agreeing metres without a direction, of corners and furniture; behind, before (K,): metres of parallel wall that
    were seen from opposite sides and from the same side.
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
    behind: FloatArray
    before: FloatArray


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
        _, labels = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
        codes = np.full(int(labels.max()) + 1, 255, np.uint8)
        codes[labels[rows, cols]] = _direction_codes(outline.normals, outline.faced)
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
    return Probe(
        points, lengths, normals, outline.faced[chosen], blocks.reshape(-1).astype(np.int64), _lines_of(points, normals)
    )


def judge_poses(surface: Surface, probe: Probe, poses: FloatArray, least_cell_m: float) -> Agreements:
    """Count the probe's wall on the surface at poses (K, 3) of its grid; least_cell_m: cell of the coarser map."""
    return judge_placed(surface, probe, place(probe.points, poses), poses, least_cell_m)


def judge_placed(
    surface: Surface, probe: Probe, placed: FloatArray, poses: FloatArray, least_cell_m: float
) -> Agreements:
    """Count the probe's wall as `judge_poses` does, with its points at places (K, N, 2) near those of the poses."""
    tolerances, violations = limits_m(least_cell_m)
    seen = _look_up(surface, probe, placed, poses[:, 2])
    lengths = probe.lengths.astype(np.float32)
    hit = seen.distance <= tolerances[1]
    against = seen.free & (seen.distance > violations[1])
    far_off = seen.free & (seen.distance > violations[2])
    directed = hit & (seen.across >= 0.0)
    along = hit & (seen.across >= _PARALLEL)
    crossing = directed & (seen.across < _CROSSING)
    straight = probe.lines >= 0
    hold = _hold(np.where(along, lengths, np.float32(0.0)), probe, poses)
    good, bad = _blocks(probe.blocks, np.where(hit & ~crossing, lengths, 0.0), np.where(against, lengths, 0.0))
    good_lines, bad_lines, variety = _lines(probe.lines, np.where(along, lengths, 0.0), np.where(against, lengths, 0.0))
    return Agreements(
        known=np.isfinite(seen.distance) @ lengths,
        hits=np.column_stack([(seen.distance <= limit) @ lengths for limit in tolerances]),
        conflicts=np.column_stack([(seen.free & (seen.distance > limit)) @ lengths for limit in violations]),
        parallel=np.column_stack([(along & (seen.distance <= limit)) @ lengths for limit in tolerances[:2]]),
        crossing=crossing @ lengths,
        weak=hold.weak,
        strong=hold.strong,
        weak_direction=hold.weak_direction,
        turning=hold.turning,
        good=good,
        bad=bad,
        hit_gap=_rms(np.where(hit, seen.distance, 0.0), hit, lengths),
        worst=np.column_stack([_most_in_a_block(probe.blocks, each, lengths) for each in (against, far_off)]),
        against=np.column_stack([(each & straight) @ lengths for each in (against, far_off)]),
        good_lines=good_lines,
        bad_lines=bad_lines,
        variety=variety,
        rough=((seen.distance <= tolerances[0]) & (seen.across < 0.0)) @ lengths,
        behind=(along & (seen.facing < 0)) @ lengths,
        before=(along & (seen.facing > 0)) @ lengths,
    )


def net_metres(surface: Surface, probe: Probe, poses: FloatArray, least_cell_m: float) -> FloatArray:
    """Return hits less twice the conflicts (K, 3) at the three tolerances: `judge_poses` for very many poses."""
    seen = _look_up(surface, probe, place(probe.points, poses), poses[:, 2])
    lengths = probe.lengths.astype(np.float32)
    return np.column_stack(
        [
            (seen.distance <= tolerance) @ lengths - 2.0 * ((seen.free & (seen.distance > violation)) @ lengths)
            for tolerance, violation in zip(*limits_m(least_cell_m), strict=True)
        ]
    )


def place(points: FloatArray, poses: FloatArray) -> FloatArray:
    """Return points (N, 2) as each of poses (K, 3) places them: (K, N, 2)."""
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    placed = np.empty((len(poses), len(points), 2))
    placed[:, :, 0] = poses[:, :1] + cos * points[:, 0] - sin * points[:, 1]
    placed[:, :, 1] = poses[:, 1:2] + sin * points[:, 0] + cos * points[:, 1]
    return placed


def limits_m(least_cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the distances (3,) up to which walls are one, and those (3,) from which they contradict."""
    return (
        np.maximum(TOLERANCES_M, _TOLERANCE_CELLS * least_cell_m),
        np.maximum(VIOLATIONS_M, _VIOLATION_CELLS * least_cell_m),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What N points meet at K poses: distance (K, N) to the nearest wall, inf on cells the surface does not know; free
    (K, N) cells; across (K, N): cosine between the walls' normals, -1 where one has none; facing (K, N): 1 where both
    were seen from the same side, -1 from opposite sides, 0 where that is not known.
    """

    distance: NDArray[np.float32]
    free: NDArray[np.bool_]
    across: NDArray[np.float32]
    facing: NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class _Hold:
    """How parallel wall holds a pose, see Agreements."""

    weak: FloatArray
    strong: FloatArray
    weak_direction: FloatArray
    turning: FloatArray


def _look_up(surface: Surface, probe: Probe, placed: FloatArray, yaws: FloatArray) -> _Seen:
    """Return what the probe's points, at places (K, N, 2) and turned by yaws (K,), meet."""
    shape = placed.shape[:2]
    distance, free = np.full(shape, np.inf, np.float32), np.zeros(shape, np.bool_)
    across, facing = np.full(shape, -1.0, np.float32), np.zeros(shape, np.int8)
    walls = surface.walls
    angles = np.where((probe.normals != 0.0).any(axis=1), np.arctan2(probe.normals[:, 1], probe.normals[:, 0]), np.nan)
    _fill(
        (walls.distances, surface.seen, surface.directions), walls.resolution_m, placed, yaws, angles, probe.faced,
        (distance, free, across, facing),
    )  # fmt: skip
    return _Seen(distance, free, across, facing)


def _hold(weights: NDArray[np.float32], probe: Probe, poses: FloatArray) -> _Hold:
    """Return how walls of weights (K, N), in metres, hold their poses (K, 3)."""
    nx, ny = probe.normals.T
    turn = ny * probe.points[:, 0] - nx * probe.points[:, 1]  # by how much a turn of the probe moves a wall
    xx, xy, yy, x, y, tt = (
        weights @ factor for factor in (nx * nx, nx * ny, ny * ny, turn * nx, turn * ny, turn * turn)
    )
    spread = np.hypot(0.5 * (xx - yy), xy)
    determinant = np.maximum((xx + 1e-6) * (yy + 1e-6) - xy * xy, 1e-9)
    explained = ((yy + 1e-6) * x * x - 2.0 * xy * x * y + (xx + 1e-6) * y * y) / determinant
    weakest = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * np.pi
    return _Hold(
        np.maximum(0.5 * (xx + yy) - spread, 0.0),
        0.5 * (xx + yy) + spread,
        weakest + poses[:, 2],
        np.maximum(tt - explained, 0.0),
    )


def _sums_by(groups: NDArray[np.int64], values: NDArray[np.floating]) -> FloatArray:
    """Return the sums (K, G) of values (K, N) over the groups; a negative group counts nowhere."""
    counted = np.flatnonzero(groups >= 0)
    if len(counted) == 0:
        return np.zeros((len(values), 0))
    order = counted[np.argsort(groups[counted], kind="stable")]
    starts = np.flatnonzero(np.diff(groups[order], prepend=-1))
    return np.asarray(np.add.reduceat(values[:, order], starts, axis=1), dtype=np.float64)


def _blocks(
    blocks: NDArray[np.int64], agreeing: NDArray[np.floating], contradicting: NDArray[np.floating]
) -> tuple[FloatArray, FloatArray]:
    """Return how many blocks (K,) agree and how many contradict."""
    for_it, against = _sums_by(blocks, agreeing), _sums_by(blocks, contradicting)
    judged = for_it + against
    enough = judged >= _BLOCK_LEAST_M
    good = (enough & (for_it >= _BLOCK_AGREES * judged)).sum(axis=1)
    bad = (enough & (for_it <= _BLOCK_FAILS * judged)).sum(axis=1)
    return good.astype(np.float64), bad.astype(np.float64)


def _most_in_a_block(blocks: NDArray[np.int64], mask: NDArray[np.bool_], lengths: NDArray[np.float32]) -> FloatArray:
    """Return the metres (K,) that are set in the block where most are."""
    return np.asarray(_sums_by(blocks, np.where(mask, lengths, np.float32(0.0))).max(axis=1, initial=0.0))


def _lines(
    lines: NDArray[np.int64], agreeing: NDArray[np.floating], contradicting: NDArray[np.floating]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how many lines (K,) agree, how many contradict, and over how many the agreement is spread."""
    for_it, against = _sums_by(lines, agreeing), _sums_by(lines, contradicting)
    good = (for_it >= _LINE_LEAST_M) & (for_it > against)
    bad = ~good & (against >= _LINE_LEAST_M)
    share = for_it / np.maximum(for_it.sum(axis=1, keepdims=True), 1e-9)
    entropy = -(share * np.log(np.maximum(share, 1e-12))).sum(axis=1)
    return good.sum(axis=1).astype(np.float64), bad.sum(axis=1).astype(np.float64), np.exp(entropy)


def _rms(values: NDArray[np.floating], mask: NDArray[np.bool_], lengths: NDArray[np.float32]) -> FloatArray:
    return np.asarray(np.sqrt((values * values) @ lengths / np.maximum(mask @ lengths, 1e-9)), dtype=np.float64)


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
    # Bins lie about 0, 15, 30 ... deg: walls along the axes must not fall between two.
    direction = np.rint(np.arctan2(normals[:, 1], normals[:, 0]) / _LINE_RAD) % round(np.pi / _LINE_RAD)
    one_side = np.column_stack([np.cos(direction * _LINE_RAD), np.sin(direction * _LINE_RAD)])
    side = np.where((normals * one_side).sum(axis=1) < 0.0, -1.0, 1.0)
    middle = points.mean(axis=0) if len(points) else np.zeros(2)
    place = np.floor(side * ((points - middle) * normals).sum(axis=1) / _LINE_M)
    straight = (normals != 0.0).any(axis=1)
    _, numbers = np.unique(np.column_stack([direction, place])[straight], axis=0, return_inverse=True)
    lines = np.full(len(points), -1, np.int64)
    lines[straight] = numbers.reshape(-1)
    return lines


def _direction_codes(normals: FloatArray, faced: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the directions (N,) of normals (N, 2) as in Surface."""
    angle = np.arctan2(normals[:, 1], normals[:, 0])
    signed = np.rint(angle * (_CODES / (2.0 * np.pi))) % _CODES
    unsigned = _CODES + np.rint(angle * (_CODES / np.pi)) % _CODES
    codes = np.where(faced, signed, unsigned).astype(np.uint8)
    return np.where((normals == 0.0).all(axis=1), np.uint8(255), codes)


@njit(cache=True, nogil=True)
def _fill(
    layers: tuple[Distances, States, NDArray[np.uint8]],
    resolution_m: float,
    placed: FloatArray,
    yaws: FloatArray,
    angles: FloatArray,
    faced: NDArray[np.bool_],
    found: tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32], NDArray[np.int8]],
) -> None:
    """Fill what `_look_up` returns; layers of a surface: distances, seen, directions; angles (N,), nan for none."""
    distances, seen, directions = layers
    distance, free, across, facing = found
    rows, cols = distances.shape
    for k in range(placed.shape[0]):
        for n in range(placed.shape[1]):
            col, row = math.floor(placed[k, n, 0] / resolution_m), math.floor(placed[k, n, 1] / resolution_m)
            if col < 0 or row < 0 or col >= cols or row >= rows or seen[row, col] == UNKNOWN:
                continue
            distance[k, n] = distances[row, col]
            free[k, n] = seen[row, col] == FREE
            code = directions[row, col]
            if code == 255 or math.isnan(angles[n]):
                continue
            one_sided = code < _CODES
            other = code * (2.0 * math.pi / _CODES) if one_sided else (code - _CODES) * (math.pi / _CODES)
            cosine = math.cos(yaws[k] + angles[n] - other)
            across[k, n] = abs(cosine)
            if one_sided and faced[n]:
                facing[k, n] = 1 if cosine > 0.0 else -1


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
