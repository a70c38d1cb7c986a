"""The arithmetic of regulated pure pursuit, compiled: a car that looks a second ahead takes forty such steps each time.

A path is poses (N, 3), metres along it at each (N,), and speeds without sign (N,); a stretch of it, in one gear, goes
from pose number begin to end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WAY_STEP_M = 0.02


class Stretch(NamedTuple):
    """Numbers of the first and last pose, and the gear, 1 or -1."""

    begin: int
    end: int
    gear: int


class PursuitRule(NamedTuple):
    """Of FollowerSettings, what the arithmetic needs."""

    lookahead_s: float
    least_lookahead_m: float
    most_lookahead_m: float
    slow_radius_m: float
    near_m: float
    least_mps: float
    reached_m: float
    curvature_limit_1pm: float
    off_path_m: float
    off_path_rad: float
    window_m: float


class Spot(NamedTuple):
    """The car on a stretch: metres along the path and beside it, how far turned from it, whether at the end."""

    along_m: float
    across_m: float
    turned_rad: float
    at_end: bool


@numba.njit(cache=True)
def spot_of(
    poses: FloatArray, marks: FloatArray, stretch: Stretch, at_m: float, rule: PursuitRule, pose: FloatArray
) -> Spot:
    """Return where a car at a pose (3,) is, looked for around where it was last, and never behind that."""
    first = max(stretch.begin, int(np.searchsorted(marks, at_m - rule.window_m)))
    last = min(stretch.end, int(np.searchsorted(marks, at_m + rule.window_m)))
    n, nearest = first, math.inf
    for k in range(first, last + 1):
        away = (poses[k, 0] - pose[0]) ** 2 + (poses[k, 1] - pose[1]) ** 2
        if away < nearest:
            n, nearest = k, away
    cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
    dx, dy = pose[0] - poses[n, 0], pose[1] - poses[n, 1]
    ahead_m, left_m = cos * dx + sin * dy, cos * dy - sin * dx  # the car as the path's pose sees it
    turned_rad = (pose[2] - poses[n, 2] + math.pi) % (2.0 * math.pi) - math.pi
    along_m = min(max(marks[n] + stretch.gear * ahead_m, marks[stretch.begin]), marks[stretch.end])
    at_end = n == stretch.end and stretch.gear * ahead_m >= -rule.reached_m
    return Spot(max(at_m, along_m), stretch.gear * left_m, turned_rad, at_end)


@numba.njit(cache=True)
def curvature_1pm(
    poses: FloatArray,
    marks: FloatArray,
    stretch: Stretch,
    along_m: float,
    speed_mps: float,
    rule: PursuitRule,
    pose: FloatArray,
) -> float:
    """Return the curvature of the circle through the car, tangent to it, and the carrot.

    Beyond the end of the stretch the carrot is on the straight line that goes on from it.
    """
    wanted_m = rule.lookahead_s * max(abs(speed_mps), rule.least_mps)
    at_m = along_m + min(max(wanted_m, rule.least_lookahead_m), rule.most_lookahead_m)
    part = marks[stretch.begin : stretch.end + 1]
    n = stretch.begin + min(max(int(np.searchsorted(part, at_m)), 1), len(part) - 1)
    over_m = max(0.0, at_m - marks[stretch.end])
    share = 1.0
    if over_m == 0.0 and marks[n] > marks[n - 1]:
        share = (at_m - marks[n - 1]) / (marks[n] - marks[n - 1])
    yaw = poses[stretch.end, 2]
    x = poses[n - 1, 0] + share * (poses[n, 0] - poses[n - 1, 0]) + stretch.gear * over_m * math.cos(yaw)
    y = poses[n - 1, 1] + share * (poses[n, 1] - poses[n - 1, 1]) + stretch.gear * over_m * math.sin(yaw)
    dx, dy = x - pose[0], y - pose[1]
    sideways_m = math.cos(pose[2]) * dy - math.sin(pose[2]) * dx
    curvature = float(2.0 * sideways_m / max(dx * dx + dy * dy, 1e-6))
    return min(max(curvature, -rule.curvature_limit_1pm), rule.curvature_limit_1pm)


@numba.njit(cache=True)
def regulated_mps(
    marks: FloatArray, speeds: FloatArray, along_m: float, curvature: float, clearance_m: float, rule: PursuitRule
) -> float:
    """Return the speed, without its sign: the path's, less in curves and near things."""
    n = min(max(int(np.searchsorted(marks, along_m)), 1), len(marks) - 1)
    speed = float(speeds[n])
    if marks[n] > marks[n - 1] and along_m < marks[n]:
        share = max(0.0, (along_m - marks[n - 1]) / (marks[n] - marks[n - 1]))
        speed = float(speeds[n - 1] + share * (speeds[n] - speeds[n - 1]))
    # The path's own curve may be tighter than the one to the carrot.
    speed *= min(1.0, 1.0 / max(abs(curvature) * rule.slow_radius_m, 1e-9))
    speed *= min(1.0, max(clearance_m, 0.0) / rule.near_m)
    return max(speed, rule.least_mps)


@numba.njit(cache=True)
def way_on(
    path: tuple[FloatArray, FloatArray, FloatArray],
    stretch: Stretch,
    at_m: float,
    rule: PursuitRule,
    pose: FloatArray,
    motion: tuple[float, float, float],
) -> FloatArray:
    """Return the poses (K, 3), the first the car's own, that it is going to take up to the end of its stretch.

    motion: its speed, how far it is followed in m, and its clearance, which are taken to stay. at_m: metres along the
    path where it was last. It ends where the car has lost its path.
    """
    poses, marks, speeds = path
    speed_mps, reach_m, clearance_m = motion
    most = max(math.ceil(reach_m / WAY_STEP_M), 0) + 1
    way = np.empty((most, 3))
    way[0] = pose
    for n in range(1, most):
        spot = spot_of(poses, marks, stretch, at_m, rule, way[n - 1])
        at_m = spot.along_m
        if spot.at_end or abs(spot.across_m) > rule.off_path_m or abs(spot.turned_rad) > rule.off_path_rad:
            return way[:n]
        curvature = curvature_1pm(poses, marks, stretch, at_m, speed_mps, rule, way[n - 1])
        speed_mps = regulated_mps(marks, speeds, at_m, curvature, clearance_m, rule)
        step_m = stretch.gear * WAY_STEP_M
        middle = way[n - 1, 2] + step_m * curvature / 2.0  # of the chord: within a micrometre of the arc
        way[n, 0] = way[n - 1, 0] + step_m * math.cos(middle)
        way[n, 1] = way[n - 1, 1] + step_m * math.sin(middle)
        way[n, 2] = way[n - 1, 2] + step_m * curvature
    return way
