"""Checks of a plan's two ends before any search: typed errors, and the nearest pose that would do instead.

The ways of the car are not searched here. Two ends in different regions have no way between them; two in one region may
still have none. What is asked of a pose given as advice is that it fits and lies in the region of the other end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numba
import numpy as np
from numpy.typing import NDArray

from mapping import se2
from planning.costmap import Costmap
from planning.costmap_layers import Regions
from planning.footprint import Distances, Mask, is_free

FloatArray = NDArray[np.float64]

_TURNS = 16  # headings tried at each place
_AROUND = 16  # cells that are looked at first,
_BLOCK = 32  # before blocks of so many cells a side,
_PLACES = 2000  # and there at most so many where the rear axle could be
_STEPS = 4  # a tolerance is searched in, to each side


class PlanError(str, Enum):
    """Why there is no path: the names of nav2's ComputePathToPose, and three of our own."""

    start_outside_map = "START_OUTSIDE_MAP"
    goal_outside_map = "GOAL_OUTSIDE_MAP"
    start_occupied = "START_OCCUPIED"
    goal_occupied = "GOAL_OCCUPIED"
    start_in_unknown_space = "START_IN_UNKNOWN_SPACE"
    goal_in_unknown_space = "GOAL_IN_UNKNOWN_SPACE"
    no_valid_path = "NO_VALID_PATH"
    timeout = "TIMEOUT"
    cancelled = "CANCELLED"

    @property
    def nav2_name(self) -> str:
        """The name among nav2's, which call an end in unknown space occupied."""
        return self.value.replace("IN_UNKNOWN_SPACE", "OCCUPIED")


@dataclass(frozen=True, slots=True)
class GoalTolerance:
    """How far in m, and by how much in rad, a goal that will not do may be moved."""

    distance_m: float = 0.0
    turn_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """start (3,) and goal (3,) in the map frame, the goal moved within its tolerance where that is needed.

    error: why no search is worth while, None if it is; reason: that in words, or how the goal was moved, or empty;
    advice (3,): the nearest pose that would do instead of the end at fault, None where none was found.
    """

    start: FloatArray
    goal: FloatArray
    error: PlanError | None = None
    reason: str = ""
    advice: FloatArray | None = None


def check_ends(costmap: Costmap, start: FloatArray, goal: FloatArray, tolerance: GoalTolerance) -> Ends:
    """Check two poses (3,) of base_link in the map frame."""
    ends = Ends(start, goal)
    fault = _fault(costmap, start)
    if fault is not None:
        error = PlanError[f"start_{fault[0]}"]
        reason = f"start {_words(start)} {fault[1]}"
        return replace(ends, error=error, reason=reason, advice=_advice(costmap, start, _region(costmap, goal)))
    region = _region(costmap, start)
    fault = _fault(costmap, goal)
    if fault is None and _region(costmap, goal) == region:
        return ends
    moved = _within_tolerance(costmap, goal, region, tolerance)
    if moved is not None:
        away_m, turn_rad = np.hypot(*(moved - goal)[:2]), abs(float(se2.wrap_angle(moved[2] - goal[2])))
        reason = f"the goal was moved by {away_m:.3f} m and {turn_rad:.3f} rad, within its tolerance"
        return replace(ends, goal=moved, reason=reason)
    if fault is None:
        error, reason = (
            PlanError.no_valid_path,
            "no way from start to goal is wide enough for the car, or was seen free",
        )
    else:
        error, reason = PlanError[f"goal_{fault[0]}"], f"goal {_words(goal)} {fault[1]}"
    return replace(ends, error=error, reason=reason, advice=_advice(costmap, goal, region))


def _words(pose: FloatArray) -> str:
    return f"({pose[0]:g}, {pose[1]:g}, {pose[2]:g})"


def _region(costmap: Costmap, pose: FloatArray) -> int:
    """Return the region of a pose; 0 where the rear axle cannot be."""
    cell = costmap.cell(pose)
    return int(costmap.region[cell]) if cell else 0


def _fault(costmap: Costmap, pose: FloatArray) -> tuple[str, str] | None:
    """Return the error's name without its end, and words, if the car cannot stand at a pose."""
    if costmap.cell(pose) is None:
        return "outside_map", "is outside the map"
    if costmap.fits(pose):
        return None
    x, y, yaw = costmap.local(pose).tolist()
    cell_m, corners = costmap.grid.resolution_m, costmap.vehicle.corners
    outline = se2.transform_points(np.array([x, y, yaw]), corners)
    if (outline < 0.0).any() or (outline > costmap.size_m).any():
        return "occupied", "reaches over the map's edge with the car's body"
    if is_free(costmap.occupied, costmap.to_occupied_m, cell_m, x, y, yaw, corners):
        return "in_unknown_space", "is on unknown space, which is forbidden"
    return "occupied", "stands on an occupied cell"


def _advice(costmap: Costmap, wanted: FloatArray, region: int) -> FloatArray | None:
    """Return the fitting pose in a region, in any if that is 0, nearest to the wanted one, found in steps of a cell."""
    turns = np.arange(_TURNS) * 2.0 * np.pi / _TURNS
    place = costmap.local(wanted)[:2]
    outside_m = float(np.hypot(*(place - np.clip(place, 0.0, costmap.size_m))))
    cell_m = costmap.grid.resolution_m
    near = _nearest(costmap, wanted, region, (cell_m, outside_m + _AROUND * cell_m), turns)
    return near if near is not None else _nearest(costmap, wanted, region, None, turns)


def _within_tolerance(costmap: Costmap, goal: FloatArray, region: int, tolerance: GoalTolerance) -> FloatArray | None:
    """Return the fitting pose in a region, nearest to the goal within its tolerance."""
    if costmap.cell(goal) is None and tolerance.distance_m == 0.0:
        return None
    step_m = min(tolerance.distance_m / _STEPS, costmap.grid.resolution_m)
    turns = np.linspace(-tolerance.turn_rad, tolerance.turn_rad, 2 * _STEPS + 1) if tolerance.turn_rad else np.zeros(1)
    return _nearest(costmap, goal, region, (max(step_m, 1e-6), tolerance.distance_m), turns)


def _nearest(
    costmap: Costmap, wanted: FloatArray, region: int, lattice: tuple[float, float] | None, turns: FloatArray
) -> FloatArray | None:
    """Return the fitting pose nearest to the wanted one; headings are preferred in the order of the least turn.

    lattice: steps and greatest distance in m; the whole map if None.
    """
    x, y, yaw = np.clip(costmap.local(wanted), -1e9, 1e9).tolist()
    turns = se2.wrap_angle(turns)
    headings = yaw + turns[np.argsort(np.abs(turns), kind="stable")]
    allowed, cell_m, corners = (costmap.region, region), costmap.grid.resolution_m, costmap.vehicle.corners
    arguments = (allowed, costmap.blocked, costmap.to_blocked_m, cell_m, corners, (x, y), headings)
    found = _nearest_on_map(*arguments) if lattice is None else _nearest_around(*arguments, lattice)
    return costmap.world(np.array(found)) if math.isfinite(found[0]) else None


@numba.njit(cache=True)
def _nearest_around(
    allowed: tuple[Regions, int],
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    wanted: tuple[float, float],
    headings: FloatArray,
    lattice: tuple[float, float],
) -> tuple[float, float, float]:
    """Return the fitting local pose nearest to a wanted place, in squares of steps that grow around it; or no numbers.

    allowed: regions, and which of them (0: any); lattice: steps and greatest distance in m. The squares are centred at
    the place of the map nearest to the wanted one.
    """
    regions, region = allowed
    step_m, most_m = lattice
    rows, cols = regions.shape
    x = min(max(wanted[0], 0.0), cols * cell_m)
    y = min(max(wanted[1], 0.0), rows * cell_m)
    outside_m = math.hypot(x - wanted[0], y - wanted[1])
    best_m, best = most_m * (1.0 + 1e-9), (math.nan, math.nan, math.nan)
    left, below = int(x / step_m), int(y / step_m)
    right, above = int((cols * cell_m - x) / step_m), int((rows * cell_m - y) / step_m)
    for ring in range(max(left, right, below, above) + 1):
        # The wanted place and one of the map see the map's nearest place at no acute angle.
        if math.hypot(outside_m, ring * step_m) > best_m:
            break
        for i in range(max(-ring, -below), min(ring, above) + 1):
            whole = abs(i) == ring
            first = max(-ring, -left) if whole else -ring
            for j in range(first, min(ring, right) + 1, 1 if whole else 2 * ring):
                if j < -left:
                    continue
                place_x, place_y = x + j * step_m, y + i * step_m
                row, col = min(int(place_y / cell_m), rows - 1), min(int(place_x / cell_m), cols - 1)
                wrong = regions[row, col] != region if region else regions[row, col] == 0
                if wrong:
                    continue
                away_m = math.hypot(place_x - wanted[0], place_y - wanted[1])
                if away_m > best_m or (away_m == best_m and not math.isnan(best[0])):
                    continue
                for heading in headings:
                    if is_free(blocked, distance_m, cell_m, place_x, place_y, heading, corners):
                        best_m, best = away_m, (place_x, place_y, heading)
                        break
    return best


@numba.njit(cache=True)
def _nearest_on_map(
    allowed: tuple[Regions, int],
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    wanted: tuple[float, float],
    headings: FloatArray,
) -> tuple[float, float, float]:
    """Return the fitting local pose in the middle of a cell that is nearest to a wanted place; or no numbers.

    Square blocks of cells are looked at in the order of their distance, as many as may hold a nearer place.
    """
    regions, region = allowed
    rows, cols = regions.shape
    away_m = _block_distances_m(regions, region, cell_m, wanted)
    across = (cols + _BLOCK - 1) // _BLOCK
    best_m, best = math.inf, (math.nan, math.nan, math.nan)
    places = 0
    for block in np.argsort(away_m):
        if away_m[block] >= best_m or places > _PLACES:
            break
        top, left = block // across * _BLOCK, block % across * _BLOCK
        for i in range(top, min(top + _BLOCK, rows)):
            for j in range(left, min(left + _BLOCK, cols)):
                wrong = regions[i, j] != region if region else regions[i, j] == 0
                x, y = (j + 0.5) * cell_m, (i + 0.5) * cell_m
                apart_m = math.hypot(x - wanted[0], y - wanted[1])
                if wrong or apart_m >= best_m:
                    continue
                places += 1
                for heading in headings:
                    if is_free(blocked, distance_m, cell_m, x, y, heading, corners):
                        best_m, best = apart_m, (x, y, heading)
                        break
    return best


@numba.njit(cache=True)
def _block_distances_m(regions: Regions, region: int, cell_m: float, wanted: tuple[float, float]) -> FloatArray:
    """Return the distance of each block, row by row, from a local place; inf for those without a cell of the region."""
    rows, cols = regions.shape
    across = (cols + _BLOCK - 1) // _BLOCK
    low, high = np.int32(max(region, 1)), np.int32(region if region else 2**31 - 1)
    away_m = np.full((rows + _BLOCK - 1) // _BLOCK * across, np.inf)
    for i in range(rows):
        for column in range(across):
            block = i // _BLOCK * across + column
            if away_m[block] < np.inf:
                continue
            hits = 0  # counted to the end: without a way out the loop is compiled to vector instructions
            for j in range(column * _BLOCK, min(column * _BLOCK + _BLOCK, cols)):
                hits += (regions[i, j] >= low) & (regions[i, j] <= high)
            if hits > 0:
                x, y = column * _BLOCK * cell_m, i // _BLOCK * _BLOCK * cell_m
                dx = max(x - wanted[0], wanted[0] - x - _BLOCK * cell_m, 0.0)
                dy = max(y - wanted[1], wanted[1] - y - _BLOCK * cell_m, 0.0)
                away_m[block] = math.hypot(dx, dy)
    return away_m
