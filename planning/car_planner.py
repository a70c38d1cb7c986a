"""The planner that a car uses: a first path along a route on the grid, and then the shortest that the budget allows.

Where routes cannot be followed, all that the car can reach is searched from both ends, and where that is too much,
RRT-Connect searches the whole map. What was found is shortened, and so is a path along the shortest route, which may
lead closer to walls; the cheaper of the two is the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planning.both_ends import Unreachable, search_from_both_ends
from planning.costmap import Costmap
from planning.edges import steering
from planning.first_path import Deadline, first_path, shortest_way
from planning.footprint import poses_are_free
from planning.improving import Improvement
from planning.ompl_planners import EndedBy, Limits, OmplPlanner, find_path
from planning.pieces import Gears, Pieces, words_between

FloatArray = NDArray[np.float64]

_MOST_ROUTES, _MOST_BRIDGES = 4, 4
_DETOUR_ROUTES = 2
_TRIES = 200  # changes of a path in one iteration
_STALE = 25  # iterations without gain, after which it is left at that
_LEAST_GAIN = 5e-4  # as a share of the cost
_SEEDS = 2**31 - 1


@dataclass(frozen=True, slots=True, eq=False)
class CarPath:
    """Local poses (N, 3) at most a centimetre apart, all checked, and gears (N,); how it was found.

    first_s: from the start of the search to the first path; iterations of shortening it.
    """

    poses: FloatArray
    gears: Gears
    first_s: float
    iterations: int
    ended_by: EndedBy


def find_car_path(
    costmap: Costmap, start: FloatArray, goal: FloatArray, seed: int, limits: Limits
) -> CarPath | Unreachable | None:
    """Plan between local poses (3,) that fit; None where no path was found in time.

    The search ends with limits.time_limit_s or when cancelled; shortening too, or after limits.iterations, or where
    that is None with limits.improve_s since the start. Same seed, same path, as long as no clock ended it.
    """
    deadline, ends = Deadline(limits, limits.clock()), np.array([start, goal])
    found = first_path(costmap, ends, seed, deadline, routes=_MOST_ROUTES, bridges=_MOST_BRIDGES)
    if found is None and not deadline.is_over():
        searched = search_from_both_ends(costmap, ends, deadline)
        if isinstance(searched, Unreachable):
            return searched
        found = searched
    if found is None and not deadline.is_over():
        anyhow = find_path(costmap, start, goal, OmplPlanner.rrt_connect, seed=seed, limits=deadline.rest())
        found = None if anyhow is None else words_between(anyhow.states, *steering(costmap.vehicle)[:2], 1.0, 0.0)
    return None if found is None else _shortened(costmap, ends, found, seed, deadline)


def find_detour(costmap: Costmap, start: FloatArray, goal: FloatArray, seed: int, limits: Limits) -> CarPath | None:
    """Plan as `find_car_path`, but give up soon where the way is not easily found; then None."""
    deadline, ends = Deadline(limits, limits.clock()), np.array([start, goal])
    found = first_path(costmap, ends, seed, deadline, routes=_DETOUR_ROUTES, bridges=1)
    return None if found is None else _shortened(costmap, ends, found, seed, deadline)


def _shortened(costmap: Costmap, ends: FloatArray, found: Pieces, seed: int, deadline: Deadline) -> CarPath | None:
    """Return the cheapest path that can be made of a first one in time, or the first one; every pose checked again."""
    first_s = deadline.limits.clock() - deadline.started_s
    shortening = _Shortening(costmap, found, seed, deadline)
    shortening.run(ends)
    for pieces in (shortening.best.pieces, found):
        poses, gears = pieces.sampled(costmap.vehicle.turning_radius_m)
        arguments = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m, poses, costmap.vehicle.corners)
        if poses_are_free(*arguments) < 0:
            return CarPath(poses, gears, first_s, shortening.iterations, shortening.ended_by)
    return None


class _Shortening:
    """Shortens a path, and one along the shortest route; the cheaper of the two is the best."""

    def __init__(self, costmap: Costmap, found: Pieces, seed: int, deadline: Deadline) -> None:
        self._costmap, self._seed, self._deadline = costmap, seed, deadline
        self.best = Improvement(costmap, found)
        self.iterations = 0
        self.ended_by = EndedBy.converged

    def run(self, ends: FloatArray) -> None:
        """Shorten until the budget is spent, or that is no longer of use."""
        self._shorten(self.best, _STALE)
        if not self._goes_on():
            return
        way = shortest_way(self._costmap, ends, self._seed, self._deadline, bridges=2)
        if way is not None:
            other = Improvement(self._costmap, way)
            self._shorten(other, _STALE)
            if other.cost_m < self.best.cost_m:
                self.best = other
        self._shorten(self.best, 4 * _STALE)

    def _shorten(self, path: Improvement, stale: int) -> None:
        """Shorten until so many iterations brought nothing."""
        since, cost_m = 0, path.cost_m
        while since < stale and self._goes_on():
            path.attempt(_TRIES, (self._seed + self.iterations) % _SEEDS)
            self.iterations += 1
            since += 1
            if path.cost_m < (1.0 - _LEAST_GAIN) * cost_m:
                since, cost_m = 0, path.cost_m

    def _goes_on(self) -> bool:
        """Whether there is budget left; if not, say what ended it."""
        limits = self._deadline.limits
        if limits.cancelled():
            self.ended_by = EndedBy.cancelled
        elif self._deadline.left_s <= 0.0:
            self.ended_by = EndedBy.time
        elif limits.iterations is not None:
            self.ended_by = EndedBy.budget if self.iterations >= limits.iterations else EndedBy.converged
        else:
            spent = limits.time_limit_s - self._deadline.left_s >= limits.improve_s
            self.ended_by = EndedBy.budget if spent else EndedBy.converged
        return self.ended_by is EndedBy.converged
