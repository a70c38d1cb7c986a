"""The planner that a car uses: a route on the grid as a guide, words along it, OMPL where those do not get through.

What a route promises the car may not be able to follow. Where joining gets stuck, RRT-Connect tries the few metres that
are hard; where that fails too, the place is made dear and another route is asked for. With no route left RRT-Connect
searches the whole map. What was found is then shortened, also along the shortest route, until the budget is spent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.edges import DUBINS, REEDS_SHEPP
from planning.footprint import poses_are_free
from planning.guide import Guide
from planning.improving import Improvement
from planning.joining import Candidates, candidates, join
from planning.ompl_planners import EndedBy, Limits, OmplPlanner, connect, find_path
from planning.pieces import Gears, Pieces, words_between
from planning.route import find_route

FloatArray = NDArray[np.float64]

_GREED = 1.2  # of the first route; of the one to improve along none
_NARROW_M = 0.05  # with so much room beside the car, whether it fits in the direction of a route is asked
_MOST_ROUTES, _MOST_BRIDGES = 16, 4
_MOST_CHECKS = 250  # words that joining may check
_BRIDGE_ITERATIONS = 150
_BRIDGE_LAYERS = (4, 6, 8)  # so far on a bridge may end
_ROUTE_COST = 30.0  # what a place where no way was found costs another route, as a multiple
_TRIES = 200  # changes of a path in one iteration
_STALE = 25  # iterations without gain, after which it is left at that
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


def find_car_path(costmap: Costmap, start: FloatArray, goal: FloatArray, seed: int, limits: Limits) -> CarPath | None:
    """Plan between local poses (3,) that fit; None where no path was found in time.

    The search ends with limits.time_limit_s or when cancelled; shortening too, or after limits.iterations, or where
    that is None with limits.improve_s since the start. Same seed, same path, as long as no clock ended it.
    """
    started_s = limits.clock()
    ends = np.array([start, goal])
    found = _first_path(costmap, ends, seed, limits, started_s)
    if found is None:
        return None
    first_s = limits.clock() - started_s
    improved = _Improver(costmap, ends, found, seed, limits, started_s)
    improved.run()
    for pieces in (improved.best, found):
        poses, gears = pieces.sampled(costmap.vehicle.turning_radius_m)
        arguments = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m, poses, costmap.vehicle.corners)
        if poses_are_free(*arguments) < 0:
            return CarPath(poses, gears, first_s, improved.iterations, improved.ended_by)
    return None


def _first_path(costmap: Costmap, ends: FloatArray, seed: int, limits: Limits, started_s: float) -> Pieces | None:
    """Return a free path, or None where time was up or cancelled."""
    guide = costmap.guide
    for number in range(_MOST_ROUTES):
        route = _route(costmap, guide, ends, _GREED)
        if len(route) == 0:
            break
        along = candidates(*_map(costmap), costmap.vehicle.corners, route, ends)
        pieces, stuck = _follow(costmap, along, seed, limits, bridges=_MOST_BRIDGES)
        if pieces is not None:
            return pieces
        if limits.cancelled() or limits.clock() - started_s > limits.time_limit_s:
            return None
        guide = _without(guide, along, stuck, costmap.grid.resolution_m)
    left_s = limits.time_limit_s - (limits.clock() - started_s)
    rest = replace(limits, time_limit_s=left_s)
    found = find_path(costmap, ends[0], ends[1], OmplPlanner.rrt_connect, seed=seed, limits=rest) if left_s > 0 else None
    return None if found is None else words_between(found.states, *_steering(costmap, 1.0, 0.0))


def _route(costmap: Costmap, guide: Guide, ends: FloatArray, greed: float) -> FloatArray:
    """Return a route (N, 2) in local metres from start to goal; N is 0 where there is none."""
    cell_m, vehicle = costmap.grid.resolution_m, costmap.vehicle
    first, last = (guide.cell(x, y, cell_m) for x, y in ends[:, :2].tolist())
    narrow_m = float(np.abs(vehicle.corners[:, 1]).max()) + _NARROW_M
    where = (*_map(costmap), vehicle.corners)
    cells = find_route(guide.cost, guide.room_m, guide.anchors, narrow_m, *where, first, last, greed)
    return np.asarray(guide.anchors[cells[:, 0], cells[:, 1]])


def _follow(
    costmap: Costmap, along: Candidates, seed: int, limits: Limits, *, bridges: int
) -> tuple[Pieces | None, int]:
    """Join candidates to a path, with so many bridges by RRT-Connect; or say at which candidate that got stuck."""
    vehicle = costmap.vehicle
    steering = _steering(costmap, vehicle.reverse_cost, vehicle.cusp_cost_m)
    where = (*_map(costmap), vehicle.corners, vehicle.outer_radius_m)
    parts: list[Pieces] = []
    begin = 0
    for number in range(bridges + 1):
        rest = along.after(begin)
        chain = join(*where, *steering, rest.poses, rest.layer, rest.first, rest.to_go_m, _MOST_CHECKS)
        reached = begin + int(chain[-1])
        parts.append(words_between(rest.poses[chain], *steering))
        if reached == len(along.poses) - 1:
            return _chained(parts), reached
        if number == bridges:
            break
        bridge = _bridge(costmap, along, reached, seed + number, limits)
        if bridge is None:
            break
        pieces, begin = bridge
        parts.append(pieces)
        if begin == len(along.poses) - 1:
            return _chained(parts), begin
    return None, reached


def _bridge(
    costmap: Costmap, along: Candidates, begin: int, seed: int, limits: Limits
) -> tuple[Pieces, int] | None:
    """Join the candidate to one a little further on by RRT-Connect; return the way and where it leads to, or None."""
    last = len(along.to_go_m) - 1
    here, vehicle = int(along.layer[begin]), costmap.vehicle
    few = replace(limits, iterations=None, most_iterations=_BRIDGE_ITERATIONS)
    for ahead in _BRIDGE_LAYERS:
        layer = min(here + ahead, last)
        if here + _BRIDGE_LAYERS[-1] >= last:
            layer = last
        for end in range(int(along.first[layer]), int(along.first[layer + 1]))[:1]:
            found = connect(costmap, along.poses[begin], along.poses[end], seed=seed, limits=few)
            if found is not None:
                steering = _steering(costmap, vehicle.reverse_cost, vehicle.cusp_cost_m)
                return words_between(found.states, *steering), end
        if layer == last or limits.cancelled():
            break
    return None


def _without(guide: Guide, along: Candidates, stuck: int, cell_m: float) -> Guide:
    """Make the narrowest place of the metre of route beyond a candidate so dear that another route is found."""
    layer = int(along.layer[stuck])
    cells = [guide.cell(x, y, cell_m) for x, y in along.points[max(layer - 1, 0) : layer + 5].tolist()]
    row, col = max(cells, key=lambda cell: float(-guide.room_m[cell]))
    cost = guide.cost.copy()
    cost[max(row - 2, 0) : row + 3, max(col - 2, 0) : col + 3] *= _ROUTE_COST
    return replace(guide, cost=cost)


class _Improver:
    """Shortens a path, and one along the shortest route beside it; the cheaper of the two is the best."""

    def __init__(
        self, costmap: Costmap, ends: FloatArray, found: Pieces, seed: int, limits: Limits, started_s: float
    ) -> None:
        self._costmap, self._ends, self._seed, self._limits = costmap, ends, seed, limits
        self._started_s = started_s
        self._improvement = Improvement(costmap, found)
        self.iterations = 0
        self.ended_by = EndedBy.budget

    @property
    def best(self) -> Pieces:
        """The cheapest path."""
        return self._improvement.pieces

    def run(self) -> None:
        """Shorten until the budget is spent."""
        self._shorten(_STALE)
        if self._goes_on():
            other = self._along_shortest_route()
            if other is not None:
                first, self._improvement = self._improvement, Improvement(self._costmap, other)
                self._shorten(_STALE)
                if first.cost_m <= self._improvement.cost_m:
                    self._improvement = first
                self._shorten(4 * _STALE)

    def _along_shortest_route(self) -> Pieces | None:
        costmap = self._costmap
        guide = costmap.guide
        plain = replace(guide, cost=np.where(guide.cost < 2.0, np.float32(1.0), guide.cost))
        route = _route(costmap, plain, self._ends, 1.0)
        along = candidates(*_map(costmap), costmap.vehicle.corners, route, self._ends)
        return _follow(costmap, along, self._seed, self._limits, bridges=2)[0]

    def _shorten(self, stale: int) -> None:
        """Shorten until so many iterations brought nothing."""
        since, cost_m = 0, self._improvement.cost_m
        while since < stale and self._goes_on():
            self._improvement.attempt(_TRIES, (self._seed + self.iterations) % _SEEDS)
            self.iterations += 1
            since += 1
            if self._improvement.cost_m < 0.9995 * cost_m:
                since, cost_m = 0, self._improvement.cost_m

    def _goes_on(self) -> bool:
        limits = self._limits
        spent_s = limits.clock() - self._started_s
        if limits.cancelled():
            self.ended_by = EndedBy.cancelled
        elif spent_s >= limits.time_limit_s:
            self.ended_by = EndedBy.time
        elif self.iterations < limits.iterations if limits.iterations is not None else spent_s < limits.improve_s:
            return True
        return False


def _map(costmap: Costmap) -> tuple[NDArray[np.bool_], NDArray[np.float32], float]:
    return costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m


def _steering(costmap: Costmap, reverse_cost: float, cusp_cost_m: float) -> tuple[int, float, float, float]:
    vehicle = costmap.vehicle
    return DUBINS if vehicle.forward_only else REEDS_SHEPP, vehicle.turning_radius_m, reverse_cost, cusp_cost_m


def _chained(parts: list[Pieces]) -> Pieces:
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.followed_by(part)
    return whole
