"""Whether a car gets from one pose to another at all: an exhaustive search, to judge what a planner did not solve.

From a pose the car drives short arcs and lines, both ways, over all places it gets to, which are told apart by cells and
headings (as hybrid A* does: Dolgov, Thrun, Montemerlo and Diebel 2008). Where nothing new is left and the other pose was
not met, the problem counts as unsolvable. That is no proof: two ways into one cell count as one.
"""

from __future__ import annotations

from enum import Enum

import numba
import numpy as np
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.footprint import Distances, Mask, is_free
from planning.reeds_shepp import drive

FloatArray = NDArray[np.float64]

_HEADINGS = 72
_LEAST_CELL_M = 0.05
_STEP_CELLS = 1.5  # a motion leaves its cell
_CHECK_M = 0.01
_MOST = 200_000  # places looked at from one end


class Reach(str, Enum):
    """What an exhaustive search says of two poses; undecided: it was given up."""

    reachable = "reachable"
    unreachable = "unreachable"
    undecided = "undecided"


def reach(on: Costmap, start: FloatArray, goal: FloatArray) -> Reach:
    """Search from one pose (3,) of the map frame for the other, and the other way round; ways can be driven both ways.

    For cars that drive backwards too: others would need a search against the ways.
    """
    vehicle, cell_m = on.vehicle, on.grid.resolution_m
    ends = on.local(np.array([start, goal]))
    place_m = max(cell_m, _LEAST_CELL_M)
    arguments = (on.blocked, on.to_blocked_m, cell_m, vehicle.corners, vehicle.turning_radius_m, place_m, _MOST)
    verdict = Reach.undecided
    for first, last in ((ends[0], ends[1]), (ends[1], ends[0])):
        found = int(_flood(*arguments, np.ascontiguousarray(first), np.ascontiguousarray(last)))
        if found == 1:
            return Reach.reachable
        if found == 0:
            verdict = Reach.unreachable
    return verdict


@numba.njit(cache=True)
def _flood(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    radius_m: float,
    place_m: float,
    most: int,
    first: FloatArray,
    last: FloatArray,
) -> int:
    """Return 1 where the last pose was met, 0 where nothing is left to look at, -1 where it was given up."""
    rows, cols = int(blocked.shape[0] * cell_m / place_m) + 1, int(blocked.shape[1] * cell_m / place_m) + 1
    seen = np.zeros((rows, cols, _HEADINGS), np.bool_)
    poses = np.empty((most, 3))
    poses[0] = first
    done, count = 0, 1
    turn_rad = 2.0 * np.pi / _HEADINGS
    step_m = max(_STEP_CELLS * place_m, 1.05 * turn_rad * radius_m)
    parts = int(np.ceil(step_m / _CHECK_M))
    while done < count:
        x, y, yaw = poses[done]
        done += 1
        for turn in (-1, 0, 1):
            for gear in (1, -1):
                free = True
                for part in range(1, parts + 1):
                    at_x, at_y, at_yaw = drive(x, y, yaw, gear * step_m * part / parts, turn, radius_m)
                    if not is_free(blocked, distance_m, cell_m, at_x, at_y, at_yaw, corners):
                        free = False
                        break
                if not free:
                    continue
                off_rad = (at_yaw - last[2] + np.pi) % (2.0 * np.pi) - np.pi
                if abs(at_x - last[0]) <= place_m and abs(at_y - last[1]) <= place_m and abs(off_rad) <= turn_rad:
                    return 1
                row, col = int(at_y / place_m), int(at_x / place_m)
                heading = int(at_yaw / turn_rad + 1000 * _HEADINGS) % _HEADINGS
                if seen[row, col, heading]:
                    continue
                if count == most:
                    return -1
                seen[row, col, heading] = True
                poses[count, 0], poses[count, 1], poses[count, 2] = at_x, at_y, at_yaw
                count += 1
    return 0
