"""The first path of the car's planner: a route on the grid as a guide, words along it, OMPL where it is too tight.

What a route promises the car may not be able to follow. Where joining gets stuck, RRT-Connect tries the few metres that
are hard; where that fails too, the place is made dear and another route is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.edges import steering
from planning.footprint import Distances, Mask
from planning.guide import Guide
from planning.joining import Candidates, candidates, join
from planning.ompl_planners import Limits, connect
from planning.pieces import Pieces, words_between
from planning.route import find_route

FloatArray = NDArray[np.float64]

_NARROW_M = 0.05  # with so much room beside the car, whether it fits in the direction of a route is asked
_MOST_CHECKS = 250  # words that joining may check
_BRIDGE_ITERATIONS = 150
_BRIDGE_LAYERS = (4, 6, 8)  # so far on a bridge may end
_STUCK_LAYERS, _STUCK_CELLS = (-1, 5), 2  # of the route around where it got stuck; of the guide around its narrowest
_STUCK_COST = 30.0  # what that place then costs another route, as a multiple


@dataclass(frozen=True, slots=True, eq=False)
class Deadline:
    """Limits that count from started_s, as the clock had it then."""

    limits: Limits
    started_s: float

    @property
    def left_s(self) -> float:
        """Time left, below zero when it is up."""
        return self.limits.time_limit_s - (self.limits.clock() - self.started_s)

    def is_over(self) -> bool:
        """Whether the time is up, or the search cancelled."""
        return self.limits.cancelled() or self.left_s <= 0.0

    def rest(self) -> Limits:
        """Return the limits of a search for a first path that begins now."""
        return replace(self.limits, time_limit_s=self.left_s, iterations=None)


def first_path(
    costmap: Costmap, ends: FloatArray, seed: int, deadline: Deadline, *, routes: int, bridges: int
) -> Pieces | None:
    """Return a free path between local poses (2, 3) along one of so many routes, with so many bridges at most.

    None where none of them can be followed, or the deadline is over.
    """
    guide = costmap.guide
    for _ in range(routes):
        if deadline.is_over():
            break
        route = find_guided(costmap, guide, ends, greed=1.2)
        if len(route) == 0:
            break
        along = candidates(*_map(costmap), costmap.vehicle.corners, route, ends)
        path, stuck = _follow(costmap, along, seed, deadline, bridges)
        if path is not None:
            return path
        guide = _without(guide, along, stuck, costmap.grid.resolution_m)
    return None


def shortest_way(costmap: Costmap, ends: FloatArray, seed: int, deadline: Deadline, *, bridges: int) -> Pieces | None:
    """Return a free path along the shortest route, which keeps no distance from walls; None where that fails."""
    guide = costmap.guide
    plain = replace(guide, cost=np.where(guide.cost < 2.0, np.float32(1.0), guide.cost))
    route = find_guided(costmap, plain, ends, greed=1.0)
    if len(route) == 0:
        return None
    along = candidates(*_map(costmap), costmap.vehicle.corners, route, ends)
    return _follow(costmap, along, seed, deadline, bridges)[0]


def find_guided(costmap: Costmap, guide: Guide, ends: FloatArray, *, greed: float) -> FloatArray:
    """Return a route (N, 2) in local metres between poses (2, 3), at most greed times the cheapest; N may be 0."""
    cell_m, vehicle = costmap.grid.resolution_m, costmap.vehicle
    first, last = (guide.cell(x, y, cell_m) for x, y in ends[:, :2].tolist())
    narrow_m = float(np.abs(vehicle.corners[:, 1]).max()) + _NARROW_M
    where = (*_map(costmap), vehicle.corners)
    cells = find_route(guide.cost, guide.room_m, guide.anchors, narrow_m, *where, first, last, greed)
    return np.asarray(guide.anchors[cells[:, 0], cells[:, 1]])


def _follow(
    costmap: Costmap, along: Candidates, seed: int, deadline: Deadline, bridges: int
) -> tuple[Pieces | None, int]:
    """Join candidates to a path, with bridges where joining gets stuck; or say at which candidate that was."""
    vehicle = costmap.vehicle
    words = steering(vehicle)
    where = (*_map(costmap), vehicle.corners, vehicle.outer_radius_m)
    path: Pieces | None = None
    begin, last = 0, len(along.poses) - 1
    for number in range(bridges + 1):
        rest = along.after(begin)
        chain = join(*where, *words, rest.poses, rest.layer, rest.first, rest.to_go_m, _MOST_CHECKS)
        joined = words_between(rest.poses[chain], *words)
        path = path.followed_by(joined) if path else joined
        reached = along.index_after(begin, int(chain[-1]))
        if reached == last:
            return path, reached
        bridge = _bridge(costmap, along, reached, seed + number, deadline) if number < bridges else None
        if bridge is None:
            break
        path, begin = path.followed_by(bridge[0]), bridge[1]
        if begin == last:
            return path, begin
    return None, reached


def _bridge(
    costmap: Costmap, along: Candidates, begin: int, seed: int, deadline: Deadline
) -> tuple[Pieces, int] | None:
    """Join the candidate to one a little further on by RRT-Connect; return the way and where it leads to, or None."""
    here, last = int(along.layer[begin]), len(along.to_go_m) - 1
    near_goal = here + _BRIDGE_LAYERS[-1] >= last
    for layer in (last,) if near_goal else tuple(here + ahead for ahead in _BRIDGE_LAYERS):
        if deadline.is_over():
            break
        end = int(along.first[layer])
        if end == along.first[layer + 1]:
            continue
        limits = replace(deadline.rest(), most_iterations=_BRIDGE_ITERATIONS)
        found = connect(costmap, along.poses[begin], along.poses[end], seed=seed, limits=limits)
        if found is not None:
            return words_between(found.states, *steering(costmap.vehicle)), end
    return None


def _without(guide: Guide, along: Candidates, stuck: int, cell_m: float) -> Guide:
    """Make the narrowest place of the route around a candidate so dear that another route is found."""
    layer = int(along.layer[stuck])
    part = along.points[max(layer + _STUCK_LAYERS[0], 0) : layer + _STUCK_LAYERS[1]]
    row, col = min((guide.cell(x, y, cell_m) for x, y in part.tolist()), key=lambda cell: float(guide.room_m[cell]))
    cost = guide.cost.copy()
    around = (slice(max(at - _STUCK_CELLS, 0), at + _STUCK_CELLS + 1) for at in (row, col))
    cost[tuple(around)] *= _STUCK_COST
    return replace(guide, cost=cost)


def _map(costmap: Costmap) -> tuple[Mask, Distances, float]:
    return costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m
