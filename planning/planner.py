"""OMPL's RRT (thesis section 2.6; LaValle 1998) and RRT-Connect (Kuffner and LaValle 2000) in Reeds-Shepp space.

The wheel of OMPL 2.0 has traps; what this file does about them: states are copied at once, checkers return real bools,
nothing stores the space information, only exact solutions count, ends are checked before (see plan), and simplified
paths are checked again pose by pose, because equally long Reeds-Shepp words may be exchanged by rounding.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
import ompl.base as ob
import ompl.geometric as og
import ompl.util as ou
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Checker = Callable[[float, float, float], bool]
STEP_M = 0.01  # between two checked poses the car stays within its margin


class Planner(str, Enum):
    """Which tree grows: one from the start, or one from each end."""

    rrt = "rrt"
    rrt_connect = "rrt_connect"


def find_path(
    is_valid: Checker,
    size_m: tuple[float, float],
    ends: FloatArray,
    *,
    radius_m: float,
    planner: Planner,
    time_limit_s: float,
    seed: int,
    clock: Callable[[], float],
) -> FloatArray | None:
    """Return valid poses (N, 3), at most STEP_M apart, between ends (2, 3); None if none are found in time.

    is_valid(x, y, yaw) says whether the car may be there; x and y lie between 0 and size_m. Same seed, same path, as
    long as the time suffices.
    """
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(seed + 1)  # 0 would mean "by the clock"
    space = ob.ReedsSheppStateSpace(radius_m)
    bounds = ob.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, 0.0)
        bounds.setHigh(axis, size_m[axis])
    space.setBounds(bounds)
    setup = og.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: is_valid(state.getX(), state.getY(), state.getYaw()))
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(STEP_M / space.getMaximumExtent())
    setup.setPlanner(og.RRT(information) if planner is Planner.rrt else og.RRTConnect(information))
    setup.setStartAndGoalStates(*(_state(information, end) for end in ends))
    ends_at = clock() + time_limit_s
    while (left_s := ends_at - clock()) > 0.0:
        setup.solve(left_s)
        if not setup.haveExactSolutionPath():
            return None
        poses = _checked(space, information, setup.getSolutionPath(), is_valid)
        if poses is not None:
            return poses
        setup.clear()
    return None


def _checked(space: Any, information: Any, found: Any, is_valid: Checker) -> FloatArray | None:
    """Return the poses of the simplified path, or of the one as found; None where both fail the check."""
    simple = og.PathGeometric(found)
    og.PathSimplifier(information).simplifyMax(simple)
    for path in (simple, found):
        poses = _dense(space, information, path)
        if all(is_valid(*pose) for pose in poses.tolist()):
            return poses
    return None


def _dense(space: Any, information: Any, path: Any) -> FloatArray:
    """Return poses (N, 3) along a path, at most STEP_M apart."""
    states = path.getStates()
    between = information.allocState()
    poses = [_pose(states[0])]
    for first, second in itertools.pairwise(states):
        count = max(1, math.ceil(space.distance(first, second) / STEP_M))
        for number in range(1, count):
            space.interpolate(first, second, number / count, between)
            poses.append(_pose(between))
        poses.append(_pose(second))
    return np.array(poses)


def _state(information: Any, pose: FloatArray) -> Any:
    state = information.allocState()
    x, y, yaw = pose.tolist()
    state.setX(x)
    state.setY(y)
    state.setYaw(yaw)
    return state


def _pose(state: Any) -> tuple[float, float, float]:
    return state.getX(), state.getY(), state.getYaw()
