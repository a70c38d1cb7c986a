"""From a map, two poses and a car to a path, or to the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.ends import GoalTolerance, PlanError, check_ends
from planning.errors import PlanningError
from planning.footprint import is_free
from planning.path import Path, path_along
from planning.planner import Planner, find_path
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]


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
    ends = check_ends(drivable, start, goal, GoalTolerance())
    if ends.error is not None:
        return PlanResult(None, ends.error, ends.reason, advice=ends.advice)
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
