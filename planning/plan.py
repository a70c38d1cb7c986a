"""From a map, two poses and a car to a path, or to the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from planning.car_planner import find_car_path
from planning.costmap import Costmap
from planning.ends import GoalTolerance, PlanError, check_ends
from planning.errors import PlanningError
from planning.ompl_planners import EndedBy, Limits, OmplPlanner, find_path
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
    """budget_s: how long a search with a path in hand goes on to shorten it; iterations: the same where a seed is given.

    time_limit_s: the end of any search. tolerance: how far a goal that does not fit may be moved.
    """

    planner: Planner = Planner.car
    budget_s: float = 0.3
    iterations: int = 100
    time_limit_s: float = 10.0
    tolerance: GoalTolerance = GoalTolerance()


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult:
    """The path, or the error with its reason; advice (3,) is the nearest pose that would do instead, where known.

    min_clearance_m: from the car's edge to the nearest occupied cell's edge, inf on a map without any. first_path_s and
    seconds: from the request to the first path and to the end. ended_by: why the search went no further.
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


def _never() -> bool:
    return False


def plan(
    costmap: Costmap,
    start: FloatArray,
    goal: FloatArray,
    settings: PlanSettings,
    *,
    seed: int | None,
    clock: Callable[[], float],
    cancelled: Callable[[], bool] = _never,
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
    first, last = costmap.local(np.array([ends.start, ends.goal]))
    limits = Limits(
        clock, cancelled, settings.time_limit_s, settings.budget_s, None if seed is None else settings.iterations
    )
    found = _Search(costmap, first, last, 0 if seed is None else seed, limits).by(settings.planner)
    seconds = clock() - started_s
    if found is None:
        if cancelled():
            reason = "the search was cancelled before a path was found"
            return PlanResult(None, PlanError.cancelled, reason, seconds=seconds, ended_by=EndedBy.cancelled)
        reason = f"no path found in {settings.time_limit_s:g} s: allow more time or a smaller turning radius"
        return PlanResult(None, PlanError.timeout, reason, seconds=seconds, ended_by=EndedBy.time)
    poses, gears, first_s, iterations, ended_by = found
    path = path_along(costmap.world(poses), gears)
    reason = f"{path.length_m:.2f} m" + (f"; {ends.reason}" if ends.reason else "")
    clearance_m = costmap.clearance_m(path.poses)
    return PlanResult(path, None, reason, clearance_m, None, first_s, clock() - started_s, iterations, ended_by)


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """One request between local poses (3,)."""

    costmap: Costmap
    start: FloatArray
    goal: FloatArray
    seed: int
    limits: Limits

    def by(self, planner: Planner) -> tuple[FloatArray, NDArray[np.int8], float | None, int, EndedBy] | None:
        """Return local poses and gears, when the first path was there, iterations, and what ended it; None without."""
        if planner is Planner.car:
            best = find_car_path(self.costmap, self.start, self.goal, self.seed, self.limits)
            return best and (best.poses, best.gears, best.first_s, best.iterations, best.ended_by)
        kind = OmplPlanner(planner.value)
        found = find_path(self.costmap, self.start, self.goal, kind, seed=self.seed, limits=self.limits)
        return found and (found.poses, found.gears, None, found.iterations, found.ended_by)
