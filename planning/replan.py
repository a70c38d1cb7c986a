"""A path on a map that has changed since: what is still free is kept, and only what is blocked is driven round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planning.car_planner import find_detour
from planning.costmap import Costmap
from planning.errors import PlanningError
from planning.ompl_planners import Limits
from planning.path import Path, path_along
from planning.plan import Kept, PlanResult, PlanSettings, never, plan

FloatArray = NDArray[np.float64]

_AROUND_M = (0.5, 1.0, 2.0, 4.0)  # kept clear of a blocked stretch on both sides, as the tries go on
_MOST_LONGER, _MOST_LONGER_M = 2.0, 2.0  # a detour may be so many times the way that it replaces, and so much more
_MOST_DETOURS = 4


def replan(
    costmap: Costmap,
    path: Path,
    progress: int,
    settings: PlanSettings,
    *,
    car: FloatArray | None = None,
    seed: int | None,
    clock: Callable[[], float],
    cancelled: Callable[[], bool] = never,
) -> PlanResult:
    """Return the rest of a path, from its pose number `progress`, on a costmap that may have changed.

    As it is where it is free still (kept: all). Else with detours round what is blocked, that leave the path as late
    and come back to it as soon as can be; its other poses are the same bits (kept: ends). Else, or where a detour would
    be long, a new plan (kept: nothing) from `car` (3,), where the car is now, the path's pose if None, to its end.
    Raises PlanningError where the path has no such pose.
    """
    if not 0 <= progress < len(path.poses):
        raise PlanningError(f"progress: {progress} is no pose of a path of {len(path.poses)}, numbered from 0")
    started_s = clock()
    rest = Path(path.poses[progress:], path.direction[progress:], path.speed_mps[progress:])
    limits = Limits(
        clock,
        cancelled,
        time_limit_s=settings.time_limit_s,
        improve_s=settings.budget_s,
        iterations=None if seed is None else settings.iterations,
    )
    mended = _mended(costmap, rest, limits, 0 if seed is None else seed)
    if mended is None:
        here = rest.poses[0] if car is None else car
        left = replace(settings, time_limit_s=max(settings.time_limit_s - (clock() - started_s), 0.0))
        result = plan(costmap, here, rest.poses[-1], left, seed=seed, clock=clock, cancelled=cancelled)
        return replace(result, seconds=clock() - started_s)
    kept = Kept.all if mended is rest else Kept.ends
    reason = f"{mended.length_m:.2f} m, " + ("as before" if mended is rest else "as before but for a detour")
    clearance_m, seconds = costmap.clearance_m(mended.poses), clock() - started_s
    return PlanResult(mended, None, reason, clearance_m, first_path_s=seconds, seconds=seconds, kept=kept)


def _mended(costmap: Costmap, path: Path, limits: Limits, seed: int) -> Path | None:
    """Return the path itself where it is free, else with detours; None where those do not do."""
    for _ in range(_MOST_DETOURS):
        blocked = costmap.first_misfit(path.poses)
        if blocked is None:
            return path
        detoured = _detoured(costmap, path, blocked, limits, seed)
        if detoured is None:
            return None
        path = detoured
    return path if costmap.all_fit(path.poses) else None


def _detoured(costmap: Costmap, path: Path, blocked: int, limits: Limits, seed: int) -> Path | None:
    """Return the path with a way round the blocked stretch that begins at a pose; None where none is short enough."""
    poses = path.poses
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    free = next((number for number in range(blocked, len(poses)) if costmap.fits(poses[number])), None)
    if free is None or blocked == 0:
        return None
    last = (-1, -1)
    for around_m in _AROUND_M:
        before = max(int(np.searchsorted(along_m, along_m[blocked] - around_m, "right")) - 1, 0)
        behind = min(int(np.searchsorted(along_m, along_m[free] + around_m)), len(poses) - 1)
        while behind < len(poses) and not costmap.fits(poses[behind]):
            behind += 1
        if behind == len(poses) or (before, behind) == last:
            break
        last = before, behind
        start, goal = costmap.local(poses[[before, behind]])
        found = find_detour(costmap, start, goal, seed, limits)
        if found is None:
            continue
        way = path_along(costmap.world(found.poses), found.gears)
        if way.length_m <= _MOST_LONGER * (along_m[behind] - along_m[before]) + _MOST_LONGER_M:
            gears = (path.direction[:before], way.direction[:-1], path.direction[behind:])
            return path_along(np.vstack([poses[: before + 1], way.poses[1:-1], poses[behind:]]), np.concatenate(gears))
    return None
