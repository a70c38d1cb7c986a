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
from planning.footprint import Distances, Mask, is_free

FloatArray = NDArray[np.float64]


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

    Places outside the grid are touched. The poses at the beginning at which the car touches something already do not
    count where it comes free again: else it could never be got off a wall.
    """
    local = np.ascontiguousarray(costmap.local(poses))
    grid = (costmap.occupied, costmap.to_occupied_m, costmap.grid.resolution_m)
    first = int(first_touch(*grid, local, costmap.vehicle.body))
    return None if first < 0 else first


@numba.njit(cache=True)
def first_touch(occupied: Mask, distance_m: Distances, cell_m: float, poses: FloatArray, body: FloatArray) -> int:
    """Return the number of the first of poses (N, 3) at which the body is not free after it was; -1 if at none.

    0 where it is free at no pose.
    """
    was_free = False
    for n in range(len(poses)):
        if is_free(occupied, distance_m, cell_m, poses[n, 0], poses[n, 1], poses[n, 2], body):
            was_free = True
        elif was_free:
            return n
    return -1 if was_free or len(poses) == 0 else 0
