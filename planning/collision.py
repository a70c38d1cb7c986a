"""A look ahead along what the car is about to do: where its body would touch something, in how many metres.

The exact outline, without the margin that plans keep, on the grid as it is known now. nav2's RPP follows the circle of
the present command; near walls that warns of what the next command avoids, so here the follower is asked for its way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.errors import PlanningError
from planning.footprint import Distances, Mask, bounds, is_free, separation_m

FloatArray = NDArray[np.float64]
_DEEPER_M = 1e-4


@dataclass(frozen=True, slots=True)
class LookAheadSettings:
    """horizon_s: how long ahead; least_m: and at least so far, which a slow car that is led into a wall needs.

    deceleration_mps2: of braking: the look is never shorter than the way to standstill and latency_s of driving on.
    """

    horizon_s: float = 1.0
    least_m: float = 0.05
    deceleration_mps2: float = 1.0
    latency_s: float = 0.2

    def __post_init__(self) -> None:
        for name in ("horizon_s", "deceleration_mps2"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise PlanningError(f"look-ahead: {name} is {value}, expected a finite number above 0")

    def reach_m(self, speed_mps: float) -> float:
        """Return how far the car is followed at a speed."""
        speed = abs(speed_mps)
        braking_m = speed * self.latency_s + speed**2 / (2.0 * self.deceleration_mps2)
        return max(speed * self.horizon_s, braking_m, self.least_m)


def contact_at(costmap: Costmap, poses: FloatArray) -> int | None:
    """Return the number of the first of map-frame poses (N, 3) at which the body touches something; None if at none.

    Places outside the grid are touched. What the car touches at the first pose it may leave, but not touch deeper: else
    it could never be got off a wall.
    """
    local = np.ascontiguousarray(costmap.local(poses))
    grid = (costmap.occupied, costmap.to_occupied_m, costmap.grid.resolution_m)
    first = int(first_contact(*grid, local, costmap.vehicle.body))
    return None if first < 0 else first


@numba.njit(cache=True)
def first_contact(occupied: Mask, distance_m: Distances, cell_m: float, poses: FloatArray, corners: FloatArray) -> int:
    """Return the number of the first of local poses (N, 3) that touches a cell deeper than the first does; -1: none.

    0 where the first pose is not inside the grid.
    """
    for n in range(len(poses)):
        x, y, yaw = poses[n, 0], poses[n, 1], poses[n, 2]
        if not is_free(occupied, distance_m, cell_m, x, y, yaw, corners) and _is_deeper(
            occupied, cell_m, poses[0], poses[n], corners
        ):
            return n
    return -1


@numba.njit(cache=True)
def _is_deeper(occupied: Mask, cell_m: float, first: FloatArray, pose: FloatArray, corners: FloatArray) -> bool:
    """Whether a pose (3,) reaches over the grid's edge, or into an occupied cell deeper than a first pose (3,)."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    low_x, high_x, low_y, high_y = bounds(corners, pose[0], pose[1], cos, sin)
    rows, cols = occupied.shape
    if not (low_x >= 0.0 and low_y >= 0.0 and high_x <= cols * cell_m and high_y <= rows * cell_m):
        return True
    first_cos, first_sin = math.cos(first[2]), math.sin(first[2])
    half = cell_m / 2.0
    for i in range(int(low_y / cell_m), min(math.ceil(high_y / cell_m), rows)):
        for j in range(int(low_x / cell_m), min(math.ceil(high_x / cell_m), cols)):
            if not occupied[i, j]:
                continue
            x, y = (j + 0.5) * cell_m, (i + 0.5) * cell_m
            apart_m = separation_m(corners, cos, sin, x - pose[0], y - pose[1], half)
            if apart_m < -_DEEPER_M:
                before_m = separation_m(corners, first_cos, first_sin, x - first[0], y - first[1], half)
                if apart_m < min(before_m, 0.0) - _DEEPER_M:
                    return True
    return False
