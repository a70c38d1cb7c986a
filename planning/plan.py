"""From a map, two poses and a car to a path, or to the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.errors import PlanningError
from planning.footprint import is_free
from planning.path import Path, path_along
from planning.planner import Planner, find_path
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]
_ADVICE_CELLS = 4000  # looked at, nearest first
_ADVICE_TURNS = 16


class PlanError(str, Enum):
    """Why there is no path: the names of nav2's ComputePathToPose, and CANCELLED."""

    start_outside_map = "START_OUTSIDE_MAP"
    goal_outside_map = "GOAL_OUTSIDE_MAP"
    start_occupied = "START_OCCUPIED"
    goal_occupied = "GOAL_OCCUPIED"
    no_valid_path = "NO_VALID_PATH"
    timeout = "TIMEOUT"
    cancelled = "CANCELLED"


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """planner, what unknown space means, and how long the search may take in s."""

    planner: Planner = Planner.rrt_connect
    unknown: UnknownSpace = UnknownSpace.forbidden
    time_limit_s: float = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """The path, or the error with its reason; advice (3,) is the nearest pose that would do instead, where known.

    min_clearance_m: from the car's edge to the nearest occupied cell's edge, inf on a map without any.
    """

    path: Path | None
    error: PlanError | None
    reason: str
    min_clearance_m: float | None = None
    advice: FloatArray | None = None


def plan(
    grid: OccupancyGrid,
    start: FloatArray,
    goal: FloatArray,
    vehicle: Vehicle,
    settings: PlanSettings,
    seed: int,
    *,
    clock: Callable[[], float],
) -> PlanResult:
    """Plan from start (3,) to goal (3,), poses of base_link in the map frame. clock gives seconds, for the time limit.

    Every pose of the path was checked with the exact footprint and margin. Raises PlanningError for poses that are not
    finite. Same seed, same path, as long as the time suffices.
    """
    for name, pose in (("start", start), ("goal", goal)):
        if not np.isfinite(pose).all():
            raise PlanningError(f"{name}: {pose.tolist()} is not a finite pose: give x and y in m and yaw in rad")
    drivable = costmap(grid, vehicle, settings.unknown)
    refused = _objection(drivable, start, goal)
    if refused is not None:
        return refused
    cell_m, corners = grid.resolution_m, vehicle.corners
    blocked, distance_m = drivable.blocked, drivable.to_blocked_m
    rows, cols = blocked.shape
    found = find_path(
        lambda x, y, yaw: bool(is_free(blocked, distance_m, cell_m, x, y, yaw, corners)),
        (cols * cell_m, rows * cell_m),
        drivable.local(np.array([start, goal])),
        radius_m=vehicle.turning_radius_m,
        planner=settings.planner,
        time_limit_s=settings.time_limit_s,
        seed=seed,
        clock=clock,
    )
    if found is None:
        reason = f"no path found in {settings.time_limit_s:g} s: allow more time or a smaller turning radius"
        return PlanResult(None, PlanError.timeout, reason)
    path = path_along(se2.compose(grid.origin, found))
    return PlanResult(path, None, f"{path.length_m:.2f} m", drivable.clearance_m(path.poses))


def _objection(drivable: Costmap, start: FloatArray, goal: FloatArray) -> PlanResult | None:
    """Return what makes planning pointless, if anything does."""
    ends = (
        ("start", start, PlanError.start_outside_map, PlanError.start_occupied),
        ("goal", goal, PlanError.goal_outside_map, PlanError.goal_occupied),
    )
    for name, pose, outside, occupied in ends:
        other = goal if name == "start" else start
        where = f"{name} ({pose[0]:g}, {pose[1]:g}, {pose[2]:g})"
        if drivable.cell(pose) is None:
            return PlanResult(None, outside, f"{where} is outside the map", advice=_advice(drivable, pose, other))
        if not drivable.fits(pose):
            reason = f"{where}: {_why_not(drivable, pose)}"
            return PlanResult(None, occupied, reason, advice=_advice(drivable, pose, other))
    if _region(drivable, start) != _region(drivable, goal):
        reason = "no way from start to goal is wide enough for the car, or none that was seen"
        return PlanResult(None, PlanError.no_valid_path, reason, advice=_advice(drivable, goal, start))
    return None


def _why_not(drivable: Costmap, pose: FloatArray) -> str:
    """Say whether walls, unknown space or the map's edge keep the car from a pose."""
    x, y, yaw = drivable.local(pose).tolist()
    cell_m, corners = drivable.grid.resolution_m, drivable.vehicle.corners
    if is_free(drivable.occupied, drivable.to_occupied_m, cell_m, x, y, yaw, corners):
        return "the car would stand on unknown space, which is forbidden"
    nothing = np.zeros_like(drivable.occupied)
    if not is_free(nothing, drivable.to_occupied_m, cell_m, x, y, yaw, corners):
        return "the car would reach over the map's edge"
    return "the car would stand on an occupied cell"


def _region(drivable: Costmap, pose: FloatArray) -> int:
    """Return the region of a pose on the map; 0 where the rear axle cannot be."""
    cell = drivable.cell(pose)
    return int(drivable.region[cell]) if cell else 0


def _advice(drivable: Costmap, wanted: FloatArray, other: FloatArray) -> FloatArray | None:
    """Return the fitting pose nearest to the wanted one, in the region of the other end if that has one."""
    region = _region(drivable, other)
    rows, cols = np.nonzero(drivable.region == region if region else drivable.region > 0)
    centers = drivable.grid.cell_centers(rows, cols)
    order = np.argsort(np.hypot(*(centers - wanted[:2]).T), kind="stable")[:_ADVICE_CELLS]
    turns = sorted(np.arange(_ADVICE_TURNS) * 2.0 * np.pi / _ADVICE_TURNS, key=lambda turn: abs(se2.wrap_angle(turn)))
    for center in centers[order]:
        for turn in turns:
            pose = np.array([*center, float(se2.wrap_angle(wanted[2] + turn))])
            if drivable.fits(pose):
                return pose
    return None
