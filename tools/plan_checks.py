"""A second opinion on a published path: the body against cells, curvature, gears and ends, from the poses alone.

Nothing here is shared with the planner: the body is tested by separating axes in numpy, not by the planner's compiled
footprint, and what a path promises is measured on the poses that are published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.path import Path
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FINE_M = 0.005  # between poses at which the body is tested
_APART_M = 0.0101  # published poses are no further apart
_CURVATURE_SHARE = 0.01  # by so much a step may turn more than the turning radius lets it,
_TURN_RAD = 1e-6  # and by so much whatever its length
_END = 1e-6  # m and rad
_SIDEWAYS_SHARE = 0.01  # of a step may be across the car, rounding is
_STANDING_M = 1e-6
_TOUCH_CELLS = 1e-6  # sides that lie on each other do not collide
_POSES_AT_ONCE = 1000


@dataclass(frozen=True, slots=True)
class PathFaults:
    """How many poses or steps of a path are not as they should be, and whether an end is not what was asked for.

    colliding: poses, in between too, with the body in a bad cell; too_curved: steps that turn more than the car can;
    wrong_gears: steps against their gear or across the car; gaps: steps of more than a centimetre.
    """

    colliding: int
    too_curved: int
    wrong_gears: int
    gaps: int
    ends_off: bool

    @property
    def any(self) -> bool:
        """Whether there is any."""
        return self.ends_off or self.colliding + self.too_curved + self.wrong_gears + self.gaps > 0


def check_path(
    grid: OccupancyGrid, bad: Mask, path: Path, vehicle: Vehicle, start: FloatArray, goal: FloatArray
) -> PathFaults:
    """Check a path between two poses (3,) of the map frame; bad (rows, cols): cells that the body must not touch."""
    steps = _steps(path.poses)
    return PathFaults(
        colliding_poses(grid, bad, path.poses, vehicle.body),
        int(np.count_nonzero(steps.too_curved(vehicle.turning_radius_m))),
        int(np.count_nonzero(steps.against(path.direction[:-1]))),
        int(np.count_nonzero(steps.length_m > _APART_M)),
        not (_same(path.poses[0], start) and _same(path.poses[-1], goal)),
    )


def colliding_poses(grid: OccupancyGrid, bad: Mask, poses: FloatArray, body: FloatArray) -> int:
    """Count poses along a path (N, 3), refined to 5 mm, at which a convex body (K, 2) overlaps a bad cell.

    Being off the grid counts too; touching does not. Exact: cells are squares, tested by separating axes.
    """
    local = se2.compose(se2.inverse(grid.origin), refined(poses, _FINE_M))
    local[:, :2] /= grid.resolution_m
    body = body / grid.resolution_m
    return sum(
        int(np.count_nonzero(_overlaps(bad, local[first : first + _POSES_AT_ONCE], body)))
        for first in range(0, len(local), _POSES_AT_ONCE)
    )


def refined(poses: FloatArray, step_m: float) -> FloatArray:
    """Put poses between those of a path (N, 3), on arcs of a circle, until neighbours are at most step_m apart."""
    steps = _steps(poses)
    parts = max(1, math.ceil(steps.length_m.max(initial=0.0) / step_m))
    share = np.arange(parts)[:, np.newaxis] / parts
    half = steps.turn_rad / 2.0
    chord = np.where(
        np.abs(half) > 1e-9, np.sin(share * half) / np.where(np.abs(half) > 1e-9, np.sin(half), 1.0), share
    )
    heading = steps.course_rad - half + share * half
    between = np.stack(
        [
            poses[:-1, 0] + chord * steps.chord_m * np.cos(heading),
            poses[:-1, 1] + chord * steps.chord_m * np.sin(heading),
            poses[:-1, 2] + share * steps.turn_rad,
        ],
        axis=-1,
    )
    return np.vstack([between.transpose(1, 0, 2).reshape(-1, 3), poses[-1:]])


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """Of each step (N - 1,): chord and arc in m, turn, the chord's course in the map and in the car's frame midway."""

    chord_m: FloatArray
    length_m: FloatArray
    turn_rad: FloatArray
    course_rad: FloatArray
    ahead_m: FloatArray
    across_m: FloatArray

    def too_curved(self, radius_m: float) -> Mask:
        """Which steps turn more than a circle of the radius does."""
        most = (1.0 + _CURVATURE_SHARE) * self.length_m / radius_m + _TURN_RAD
        return np.asarray(np.abs(self.turn_rad) > most)

    def against(self, direction: NDArray[np.int8]) -> Mask:
        """Which steps do not go where their direction, 1 or -1, says, along the car's axis."""
        across = np.abs(self.across_m) > _SIDEWAYS_SHARE * self.chord_m
        return np.asarray((self.chord_m > _STANDING_M) & (across | (self.ahead_m * direction < 0.0)))


def _steps(poses: FloatArray) -> _Steps:
    delta = np.diff(poses, axis=0)
    turn = np.asarray(se2.wrap_angle(delta[:, 2]))
    chord = np.hypot(delta[:, 0], delta[:, 1])
    half = np.abs(turn) / 2.0
    arc = chord * np.where(half > 1e-9, half / np.where(half > 1e-9, np.sin(half), 1.0), 1.0)
    middle = poses[:-1, 2] + turn / 2.0
    cos, sin = np.cos(middle), np.sin(middle)
    ahead, across = delta[:, 0] * cos + delta[:, 1] * sin, delta[:, 1] * cos - delta[:, 0] * sin
    return _Steps(chord, arc, turn, np.arctan2(delta[:, 1], delta[:, 0]), ahead, across)


def _same(one: FloatArray, other: FloatArray) -> bool:
    away = np.hypot(*(one - other)[:2])
    return bool(away <= _END and abs(float(se2.wrap_angle(one[2] - other[2]))) <= _END)


def _overlaps(bad: Mask, poses: FloatArray, body: FloatArray) -> Mask:
    """Return at which poses (N, 3) a body (K, 2) overlaps a bad cell or the outside; all in cells from the corner."""
    rows, cols = bad.shape
    cos, sin = np.cos(poses[:, 2, np.newaxis]), np.sin(poses[:, 2, np.newaxis])
    x = poses[:, :1] + cos * body[:, 0] - sin * body[:, 1]
    y = poses[:, 1:2] + sin * body[:, 0] + cos * body[:, 1]
    low_x, low_y, high_x, high_y = x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)
    off = ~((low_x >= -_TOUCH_CELLS) & (low_y >= -_TOUCH_CELLS) & np.isfinite(poses).all(axis=1))
    off |= ~((high_x <= cols + _TOUCH_CELLS) & (high_y <= rows + _TOUCH_CELLS))
    result: NDArray[np.bool_] = off.copy()
    inside = np.flatnonzero(~off)
    if len(inside) == 0:
        return result
    left, bottom = np.floor(low_x[inside]).astype(np.int64), np.floor(low_y[inside]).astype(np.int64)
    wide = int((np.ceil(high_x[inside]).astype(np.int64) - left).max())
    tall = int((np.ceil(high_y[inside]).astype(np.int64) - bottom).max())
    col = np.minimum(left[:, np.newaxis, np.newaxis] + np.arange(wide), cols - 1)
    row = np.minimum(bottom[:, np.newaxis, np.newaxis] + np.arange(tall)[:, np.newaxis], rows - 1)
    hits = np.nonzero(bad[row, col])
    which = inside[hits[0]]
    cell_x = left[hits[0]] + hits[2]
    cell_y = bottom[hits[0]] + hits[1]
    known = (cell_x < cols) & (cell_y < rows)  # others stand for cells that were looked up already
    which, cell_x, cell_y = which[known], cell_x[known], cell_y[known]
    outlines = np.stack([x[which], y[which]], axis=-1)
    result[which[_squares_overlap(outlines, cell_x, cell_y)]] = True
    return np.asarray(result)


def _squares_overlap(outlines: FloatArray, cell_x: NDArray[np.int64], cell_y: NDArray[np.int64]) -> Mask:
    """Return whether convex outlines (M, K, 2) overlap the unit squares with these lower-left corners (M,)."""
    squares = np.stack([cell_x, cell_y], axis=-1)[:, np.newaxis] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    overlap = np.ones(len(outlines), np.bool_)
    for axis in (0, 1):
        overlap &= outlines[:, :, axis].min(axis=1) < squares[:, :, axis].max(axis=1) - _TOUCH_CELLS
        overlap &= outlines[:, :, axis].max(axis=1) > squares[:, :, axis].min(axis=1) + _TOUCH_CELLS
    for k in range(outlines.shape[1]):
        side = outlines[:, (k + 1) % outlines.shape[1]] - outlines[:, k]
        normal = np.stack([side[:, 1], -side[:, 0]], axis=-1) / np.hypot(side[:, 0], side[:, 1])[:, np.newaxis]
        beyond = ((squares - outlines[:, k, np.newaxis]) * normal[:, np.newaxis]).sum(axis=-1).min(axis=1)
        overlap &= beyond < -_TOUCH_CELLS
    return np.asarray(overlap)
