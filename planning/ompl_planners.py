"""OMPL's planners for a car: RRT (LaValle 1998; thesis section 2.6), RRT-Connect (Kuffner and LaValle 2000), RRT* and
its informed kind (Karaman and Frazzoli 2011, Gammell et al. 2014), and BIT* (Gammell et al. 2015).

The wheel of OMPL 2.0 has traps; what this file does about them: edges are checked by one compiled call, which also lets
other threads and signals in; nothing stores the space information; whether to stop is asked by a plain function without
a period; states are copied at once; only exact solutions count; ends are checked before (see `ends`). OMPL gives the
states where edges meet and nothing more: between them goes the word that was checked, and every pose of it is checked
again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from numpy.typing import NDArray

from mapping import se2
from planning.costmap import Costmap
from planning.edges import DUBINS, STEP_M, steer, steering, way_is_free
from planning.footprint import is_free, poses_are_free
from planning.reeds_shepp import PIECES, sample, sample_count

FloatArray = NDArray[np.float64]
_SEEDS = 2**32 - 1


class OmplPlanner(str, Enum):
    """Which of OMPL's planners searches: the first two stop at their first path, the others go on to shorten it."""

    rrt = "rrt"
    rrt_connect = "rrt_connect"
    rrt_star = "rrt_star"
    informed_rrt_star = "informed_rrt_star"
    bit_star = "bit_star"

    @property
    def improves(self) -> bool:
        """Whether it goes on after its first path."""
        return self not in (OmplPlanner.rrt, OmplPlanner.rrt_connect)


class EndedBy(str, Enum):
    """Why a search came to its end; found: it ends with its first path; converged: a path grew no shorter."""

    found = "found"
    converged = "converged"
    budget = "budget"
    time = "time"
    cancelled = "cancelled"


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Local poses (N, 3) at most STEP_M of driving apart, each of them checked, and gears (N,) as `sample` gives them.

    states (M, 3) are where OMPL's edges meet. first_s: from the start of the search to the first path. iterations
    counts how often the planner asked whether to stop.
    """

    states: FloatArray
    poses: FloatArray
    gears: NDArray[np.int8]
    first_s: float
    iterations: int
    ended_by: EndedBy


@dataclass(frozen=True, slots=True)
class Limits:
    """How long to search.

    For a first path until time_limit_s, and for as long as none is found, at most most_iterations. To shorten it until
    so many iterations since the start of the search, or where that is None until improve_s since then. clock gives
    seconds; cancelled is asked at every iteration and ends the search within a few ms.
    """

    clock: Callable[[], float]
    cancelled: Callable[[], bool]
    time_limit_s: float = 10.0
    improve_s: float = 0.3
    iterations: int | None = None
    most_iterations: int | None = None


def find_path(
    costmap: Costmap,
    start: FloatArray,
    goal: FloatArray,
    planner: OmplPlanner,
    *,
    seed: int,
    limits: Limits,
    simplify: bool = True,
) -> Found | None:
    """Search the whole map for a path between local poses (3,) that were found free; None if none is found in time.

    Words are the shortest ones: they, not the vehicle's costs, are what these planners measure. Same seed, same path,
    as long as neither time nor cancelled ends the search, and for improving planners with limits.iterations.
    """
    car = _Car(costmap, 1.0, 0.0)
    space = _space(car, np.zeros(2), np.array(costmap.size_m))
    ends = np.array([start, goal])
    return _search(car, space, ends, planner, range_m=None, seed=seed, limits=limits, simplify=simplify)


def connect(
    costmap: Costmap,
    start: FloatArray,
    goal: FloatArray,
    *,
    seed: int,
    limits: Limits,
    around_m: float = 2.0,
    range_m: float = 2.0,
) -> Found | None:
    """Join local poses (3,) a few metres apart by RRT-Connect: edges of up to range_m, no further out than around_m.

    Words are those of least cost to the vehicle. None if none is found within the limits.
    """
    ends = np.array([start, goal])
    low = np.maximum(ends[:, :2].min(axis=0) - around_m, 0.0)
    high = np.minimum(ends[:, :2].max(axis=0) + around_m, costmap.size_m)
    car = _Car(costmap, costmap.vehicle.reverse_cost, costmap.vehicle.cusp_cost_m)
    space, planner = _space(car, low, high), OmplPlanner.rrt_connect
    return _search(car, space, ends, planner, range_m=range_m, seed=seed, limits=limits, simplify=True)


class _Car:
    """The compiled checks of one car on one map, with the words that it drives."""

    def __init__(self, costmap: Costmap, reverse_cost: float, cusp_cost_m: float) -> None:
        vehicle = costmap.vehicle
        self._map = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m)
        self._body = (vehicle.corners, vehicle.outer_radius_m)
        self.kind, self.radius_m = steering(vehicle)[:2]
        self._costs = (self.radius_m, reverse_cost, cusp_cost_m)

    def fits(self, state: Any) -> bool:
        """Whether the car fits at a state of OMPL; a bool of Python's own, OMPL takes no other."""
        return bool(is_free(*self._map, *_numbers(state), self._body[0]))

    def may_drive(self, first: Any, second: Any) -> bool:
        """Whether the word from one state to another is free."""
        ends = (*_numbers(first), *_numbers(second))
        arguments = (*self._map, *self._body, self.kind, *ends, *self._costs)
        return bool(way_is_free(*arguments))

    def driven(self, first: FloatArray, second: FloatArray) -> tuple[FloatArray, NDArray[np.int8]] | None:
        """Return the poses (N, 3) and gears (N,) of the word from one pose (3,) to another; None if one is not free."""
        lengths, turns = np.zeros(PIECES), np.zeros(PIECES, np.int64)
        x, y, yaw = first.tolist()
        to_x, to_y, to_yaw = second.tolist()
        radius_m, reverse_cost, cusp_cost_m = self._costs
        steer(self.kind, x, y, yaw, to_x, to_y, to_yaw, radius_m, reverse_cost, cusp_cost_m, lengths, turns)
        count = sample_count(lengths, STEP_M)
        poses, gears = np.empty((count, 3)), np.empty(count, np.int8)
        sample(x, y, yaw, lengths, turns, radius_m, STEP_M, poses, gears)
        return (poses, gears) if poses_are_free(*self._map, poses, self._body[0]) < 0 else None


class _Edges(ob.MotionValidator):  # type: ignore[misc]  # OMPL ships no types
    """OMPL's question about an edge, answered by one compiled call. Keeps no space information, which would leak."""

    def __init__(self, information: Any, car: _Car) -> None:
        super().__init__(information)
        self._car = car

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 - OMPL's name
        return self._car.may_drive(first, second)


class _Stop:
    """Whether to stop, asked by the planner at every iteration; best_cost is None for one that stops by itself.

    Only the planner knows before the end whether it has a path: what OMPL calls the solution is set when it returns.
    """

    def __init__(self, limits: Limits, best_cost: Callable[[], Any] | None) -> None:
        self._limits, self._best_cost = limits, best_cost
        self._started_s = limits.clock()
        self._improve_until = self._started_s + limits.improve_s
        self._search_until = self._started_s + limits.time_limit_s
        self._first_s: float | None = None
        self.asked = 0
        self.ended_by = EndedBy.found

    def __call__(self) -> bool:
        self.asked += 1
        now = self._limits.clock()
        if self._first_s is None and self._best_cost is not None and math.isfinite(self._best_cost().value()):
            self._first_s = now - self._started_s
        if not self.at_once(now) and self._budget_is_spent(now):
            self.ended_by = EndedBy.budget
        return self.ended_by is not EndedBy.found

    def first_s(self) -> float:
        """Return how long the first path took; of a planner that ends with it, asked when it has ended."""
        return self._limits.clock() - self._started_s if self._first_s is None else self._first_s

    def at_once(self, now: float) -> bool:
        """Whether the search was cancelled or its time is up."""
        if self._limits.cancelled():
            self.ended_by = EndedBy.cancelled
        elif now >= self._search_until:
            self.ended_by = EndedBy.time
        else:
            return False
        return True

    def _budget_is_spent(self, now: float) -> bool:
        limits = self._limits
        if limits.most_iterations is not None and self.asked > limits.most_iterations:
            return True
        spent = now >= self._improve_until if limits.iterations is None else self.asked > limits.iterations
        return spent and self._first_s is not None


def _search(
    car: _Car,
    space: Any,
    ends: FloatArray,
    planner: OmplPlanner,
    *,
    range_m: float | None,
    seed: int,
    limits: Limits,
    simplify: bool,
) -> Found | None:
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(1 + seed % _SEEDS)  # 0 would mean "by the clock"
    setup = og.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(car.fits)
    information.setMotionValidator(_Edges(information, car))
    searching = _planner(planner, information, range_m)
    setup.setPlanner(searching)
    setup.setStartAndGoalStates(*(_state(information, end) for end in ends))
    stop = _Stop(limits, searching.bestCost if planner.improves else None)
    setup.solve(ob.PlannerTerminationCondition(stop))
    if not setup.haveExactSolutionPath():
        return None
    first_s = stop.first_s()
    found = setup.getSolutionPath()
    paths = [_states(found)]
    if simplify and stop.ended_by is not EndedBy.cancelled:
        og.PathSimplifier(information).simplify(
            found, ob.PlannerTerminationCondition(lambda: stop.at_once(limits.clock()))
        )
        paths.insert(0, _states(found))
    for states in paths:
        driven = _driven(car, states)
        if driven is not None:
            return Found(states, *driven, first_s, stop.asked, stop.ended_by)
    return None


def _driven(car: _Car, states: FloatArray) -> tuple[FloatArray, NDArray[np.int8]] | None:
    """Return poses (N, 3) and gears (N,) along the words between states (M, 3), M >= 1; None if one is not free."""
    poses, gears = [states[:1]], [np.ones(1, np.int8)]
    for first, second in itertools.pairwise(states):
        edge = car.driven(first, second)
        if edge is None:
            return None
        if len(edge[0]) > 1:  # the gear of a pose where two edges meet is the second one's
            gears[-1][-1] = edge[1][0]
            poses.append(edge[0][1:])
            gears.append(edge[1][1:])
    return np.concatenate(poses), np.concatenate(gears)


def _space(car: _Car, low: FloatArray, high: FloatArray) -> Any:
    """Return the car's space of states with x and y between low (2,) and high (2,)."""
    space = (ob.DubinsStateSpace if car.kind == DUBINS else ob.ReedsSheppStateSpace)(car.radius_m)
    bounds = ob.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, float(low[axis]))
        bounds.setHigh(axis, float(high[axis]))
    space.setBounds(bounds)
    return space


def _planner(planner: OmplPlanner, information: Any, range_m: float | None) -> Any:
    kinds = {
        OmplPlanner.rrt: og.RRT,
        OmplPlanner.rrt_connect: og.RRTConnect,
        OmplPlanner.rrt_star: og.RRTstar,
        OmplPlanner.informed_rrt_star: og.InformedRRTstar,
        OmplPlanner.bit_star: og.BITstar,
    }
    made = kinds[planner](information)
    if planner is OmplPlanner.bit_star:
        made.setPruning(False)  # takes up to a second at a time, in which it does not ask whether to stop
    if range_m is not None:
        made.setRange(range_m)
    return made


def _state(information: Any, pose: FloatArray) -> Any:
    state = information.allocState()
    x, y, yaw = pose.tolist()
    state.setX(x)
    state.setY(y)
    state.setYaw(float(se2.wrap_angle(yaw)))
    return state


def _states(path: Any) -> FloatArray:
    return np.array([_numbers(state) for state in path.getStates()])


def _numbers(state: Any) -> tuple[float, float, float]:
    return state.getX(), state.getY(), state.getYaw()
