"""From a map, two poses and a car to a path, or to the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from planning.both_ends import Unreachable
from planning.car_planner import CarPath, find_car_path
from planning.costmap import Costmap
from planning.ends import GoalTolerance, PlanError, check_ends
from planning.errors import PlanningError
from planning.ompl_planners import EndedBy, Found, Limits, OmplPlanner, find_path
from planning.path import Path, path_along

FloatArray = NDArray[np.float64]


class Planner(str, Enum):
    """Which planner: the one for cars, or one of OMPL's alone."""

    car = "car"
    rrt = "rrt"
    rrt_connect = "rrt_connect"
    rrt_star = "rrt_star"
    informed_rrt_star = "informed_rrt_star"
    bit_star = "bit_star"


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """budget_s: how long after its start a search with a path in hand goes on to shorten it.

    iterations: the same where a seed is given. time_limit_s: the end of any search. tolerance: how far a goal that does
    not fit may be moved.
    """

    planner: Planner = Planner.car
    budget_s: float = 0.3
    iterations: int = 200
    time_limit_s: float = 10.0
    tolerance: GoalTolerance = GoalTolerance()


class Kept(str, Enum):
    """What a new path has of an earlier one (see `replan`)."""

    nothing = "nothing"
    ends = "ends"
    all = "all"


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """The path, or the error with its reason; advice (3,) is the nearest pose that would do instead, where known.

    min_clearance_m: from the car's edge to the nearest occupied cell's edge, inf on a map without any. first_path_s and
    seconds: from the request to the first path and to the end. ended_by: why the search went no further; None where
    there was none. kept: what the path has of an earlier one.
    """

    path: Path | None
    error: PlanError | None
    reason: str
    min_clearance_m: float | None = None
    advice: FloatArray | None = None
    first_path_s: float | None = None
    seconds: float = 0.0
    iterations: int = 0
    ended_by: EndedBy | None = None
    kept: Kept = Kept.nothing


def never() -> bool:
    """What to pass as `cancelled` for a search that nobody cancels."""
    return False


def plan(
    costmap: Costmap,
    start: FloatArray,
    goal: FloatArray,
    settings: PlanSettings,
    *,
    seed: int | None,
    clock: Callable[[], float],
    cancelled: Callable[[], bool] = never,
) -> PlanResult:
    """Plan from start (3,) to goal (3,), poses of base_link in the map frame. clock gives seconds.

    Every pose of the path, a centimetre apart, was checked with the exact footprint and margin. With a seed the budget
    is settings.iterations and the path is the same every time, as long as the time limit does not end the search; then
    ended_by says so. Raises PlanningError for poses that are not finite.
    """
    started_s = clock()
    for name, pose in (("start", start), ("goal", goal)):
        if not np.isfinite(pose).all():
            raise PlanningError(f"{name}: {pose.tolist()} is not a finite pose: give x and y in m and yaw in rad")
    ends = check_ends(costmap, start, goal, settings.tolerance)
    if ends.error is not None:
        return PlanResult(None, ends.error, ends.reason, advice=ends.advice, seconds=clock() - started_s)
    before_s = clock() - started_s
    limits = Limits(
        clock,
        cancelled,
        time_limit_s=settings.time_limit_s - before_s,
        improve_s=settings.budget_s - before_s,
        iterations=None if seed is None else settings.iterations,
    )
    first, last = costmap.local(np.array([ends.start, ends.goal]))
    found = _search(costmap, first, last, settings.planner, 0 if seed is None else seed, limits)
    if isinstance(found, Unreachable):
        reason = "the car cannot get from start to goal, whatever it does: a smaller turning radius or margin may help"
        nearest = costmap.world(found.nearest)
        return PlanResult(None, PlanError.no_valid_path, reason, advice=nearest, seconds=clock() - started_s)
    if found is None:
        return _without_path(settings, clock() - started_s, is_cancelled=cancelled())
    path = path_along(costmap.world(found.poses), found.gears)
    return PlanResult(
        path,
        None,
        f"{path.length_m:.2f} m" + (f"; {ends.reason}" if ends.reason else ""),
        min_clearance_m=costmap.clearance_m(path.poses),
        first_path_s=before_s + found.first_s,
        seconds=clock() - started_s,
        iterations=found.iterations,
        ended_by=found.ended_by,
    )


def _search(
    costmap: Costmap, start: FloatArray, goal: FloatArray, planner: Planner, seed: int, limits: Limits
) -> CarPath | Found | Unreachable | None:
    """Search between local poses (3,)."""
    if planner is Planner.car:
        return find_car_path(costmap, start, goal, seed, limits)
    return find_path(costmap, start, goal, OmplPlanner(planner.value), seed=seed, limits=limits)


def _without_path(settings: PlanSettings, seconds: float, *, is_cancelled: bool) -> PlanResult:
    if is_cancelled:
        reason = "the search was cancelled before a path was found"
        return PlanResult(None, PlanError.cancelled, reason, seconds=seconds, ended_by=EndedBy.cancelled)
    reason = f"no path found in {settings.time_limit_s:g} s: allow more time or a smaller turning radius"
    return PlanResult(None, PlanError.timeout, reason, seconds=seconds, ended_by=EndedBy.time)
