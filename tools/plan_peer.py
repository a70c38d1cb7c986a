"""What planning looks like without compiled code: OMPL's RRT-Connect with a numpy state checker, nothing of our own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from numpy.typing import NDArray

from mapping import se2
from planning.costmap import Costmap

FloatArray = NDArray[np.float64]
_EVERY_M = 0.02  # OMPL's own motion validator looks at an edge so often
_BODY_M = 0.04  # points of the body that are looked up; its outline every so often too


@dataclass(frozen=True, slots=True)
class PeerPlan:
    """Seconds to the first path, its length in m, and the length after OMPL's simplifier and all seconds."""

    first_s: float
    first_length_m: float
    seconds: float
    length_m: float


def plan_by_peer(
    on: Costmap, start: FloatArray, goal: FloatArray, *, limit_s: float, seed: int, clock: Callable[[], float]
) -> PeerPlan | None:
    """Plan between two poses (3,) of the map frame; None where nothing is found in limit_s by the clock."""
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    began = clock()
    space = ob.ReedsSheppStateSpace(on.vehicle.turning_radius_m)
    bounds = ob.RealVectorBounds(2)
    for axis, size_m in enumerate(on.size_m):
        bounds.setLow(axis, 0.0)
        bounds.setHigh(axis, size_m)
    space.setBounds(bounds)
    setup = og.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(_Lookup(on))
    information.setStateValidityCheckingResolution(_EVERY_M / space.getMaximumExtent())
    setup.setPlanner(og.RRTConnect(information))
    setup.setStartAndGoalStates(*(_state(information, on.local(end)) for end in (start, goal)))
    setup.solve(ob.PlannerTerminationCondition(lambda: clock() - began > limit_s))
    if not setup.haveExactSolutionPath():
        return None
    first_s, first_m = clock() - began, float(setup.getSolutionPath().length())
    path = og.PathGeometric(setup.getSolutionPath())
    og.PathSimplifier(information).simplify(path, ob.PlannerTerminationCondition(lambda: clock() - began > limit_s))
    return PeerPlan(first_s, first_m, clock() - began, float(path.length()))


class _Lookup:
    """Looks up points of the body in the grid, by numpy."""

    def __init__(self, on: Costmap) -> None:
        low, high = on.vehicle.corners.min(axis=0), on.vehicle.corners.max(axis=0)
        axes = [np.linspace(low[i], high[i], 1 + int(np.ceil((high[i] - low[i]) / _BODY_M))) for i in (0, 1)]
        self._body = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        self._blocked, self._cell_m = on.blocked, on.grid.resolution_m

    def __call__(self, state: Any) -> bool:
        pose = np.array([state.getX(), state.getY(), state.getYaw()])
        cells = np.floor(se2.transform_points(pose, self._body) / self._cell_m).astype(np.int64)
        rows, cols = self._blocked.shape
        if (cells < 0).any() or (cells[:, 0] >= cols).any() or (cells[:, 1] >= rows).any():
            return False
        return not bool(self._blocked[cells[:, 1], cells[:, 0]].any())


def _state(information: Any, pose: FloatArray) -> Any:
    state = information.allocState()
    state.setX(float(pose[0]))
    state.setY(float(pose[1]))
    state.setYaw(float(se2.wrap_angle(pose[2])))
    return state
