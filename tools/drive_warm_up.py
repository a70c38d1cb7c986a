"""Driving in a made-up room, so that all compiled code is loaded before a car moves and no command waits for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from planning.costmap import Costmap
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotState
from tools.path_search import PathSearchHere

FloatArray = NDArray[np.float64]

_SIZE_M, _CELL_M = np.array([5.0, 4.0]), 0.05
_START, _GOAL = np.array([1.0, 1.2, 0.0]), np.array([3.0, 1.2, 0.0])
_TICK_S, _MOST_TICKS, _DRIVEN_TICKS = 0.05, 100, 10


def warm_up_drive() -> AutopilotState:
    """Find the place, plan and drive a few ticks, in no time that any clock shows; return the state at the end.

    That takes a second or two, on the first run ever, which compiles, a minute.
    """
    cells = np.full((round(_SIZE_M[1] / _CELL_M), round(_SIZE_M[0] / _CELL_M)), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, -1]] = 5.0
    room = OccupancyGrid(cells, _CELL_M, np.zeros(3))
    pilot = Autopilot(room, Vehicle(), [_GOAL], PathSearchHere(_straight), guess=_START)
    driven = 0
    for tick in range(_MOST_TICKS):
        now_s = 1.0 + tick * _TICK_S
        if tick % 2 == 0:
            pilot.note_scan(now_s)
            pilot.add_scan(_scan(round(now_s * 1e9), box=driven > _DRIVEN_TICKS // 2))
        pilot.tick(now_s)
        driven += pilot.state is AutopilotState.driving
        if driven == _DRIVEN_TICKS:
            break
    return pilot.state


def _straight(known: Costmap, start: FloatArray, goal: FloatArray) -> PlanResult:
    """Stand in for a planner, which is in another process; what it would ask of the costmap is asked all the same."""
    x = np.arange(start[0], goal[0], 0.01)
    path = path_along(np.column_stack([x, np.full(len(x), start[1]), np.zeros(len(x))]))
    return PlanResult(path, None, "", min_clearance_m=known.clearance_m(path.poses))


def _scan(stamp_ns: int, *, box: bool) -> MappedScan:
    """Return what the car sees of the room; box: and of something in it that the map does not have."""
    bearings = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    cos, sin = np.cos(bearings), np.sin(bearings)
    half = _CELL_M / 2.0
    to_x = np.where(cos > 0.0, _SIZE_M[0] - half - _START[0], half - _START[0]) / np.where(
        np.abs(cos) < 1e-9, 1e-9, cos
    )
    to_y = np.where(sin > 0.0, _SIZE_M[1] - half - _START[1], half - _START[1]) / np.where(
        np.abs(sin) < 1e-9, 1e-9, sin
    )
    ranges = np.minimum(np.abs(to_x), np.abs(to_y))
    if box:
        ranges[(bearings > 1.0) & (bearings < 1.2)] = 0.8
    points = np.column_stack([ranges * cos, ranges * sin])
    match = ScanMatch(se2.IDENTITY, np.zeros(3), accepted=True)
    return MappedScan(stamp_ns, se2.IDENTITY, match, points, False, False)
