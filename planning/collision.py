"""A look ahead along what the car is about to do: where its body would touch something, in how many seconds.

The exact outline, without the margin that plans keep, on the grid as it is known now; nav2's RPP does the same with
circles of constant curvature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import DriveCommand
from planning.costmap import Costmap
from planning.errors import PlanningError
from planning.footprint import Distances, Mask, is_free

FloatArray = NDArray[np.float64]

_STEP_M = 0.01


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


@dataclass(frozen=True, slots=True)
class LookAhead:
    """contact_m: driving until the body touches something, inf if not within what was looked at; so contact_s."""

    contact_m: float
    contact_s: float

    @property
    def is_free(self) -> bool:
        """Whether nothing is in the way."""
        return math.isinf(self.contact_m)


def look_ahead(
    costmap: Costmap, pose: FloatArray, command: DriveCommand, settings: LookAheadSettings = LookAheadSettings()
) -> LookAhead:
    """Follow the command from a pose (3,) in the map frame, where it takes hold, over the costmap's occupied cells.

    Places outside the grid are not free. A car that stands hits nothing. A car that touches something already may drive
    on as long as it comes free again within the look: else it could never be got off a wall.
    """
    speed = command.speed_mps
    if speed == 0.0:
        return LookAhead(math.inf, math.inf)
    local = costmap.local(pose)
    grid = (costmap.occupied, costmap.to_occupied_m, costmap.grid.resolution_m)
    steps = math.ceil(settings.reach_m(speed) / _STEP_M)
    way_m = math.copysign(_STEP_M, speed)
    free_m = _first_contact_m(*grid, local, costmap.vehicle.body, way_m, command.curvature_1pm, steps)
    return LookAhead(free_m, free_m / abs(speed))


@numba.njit(cache=True)
def _first_contact_m(
    occupied: Mask,
    distance_m: Distances,
    cell_m: float,
    pose: FloatArray,
    body: FloatArray,
    step_m: float,
    curvature_1pm: float,
    steps: int,
) -> float:
    """Return the driving in m to the first pose on a circle at which the body is not free; inf if it is at all."""
    x, y, yaw = pose[0], pose[1], pose[2]
    touches = not is_free(occupied, distance_m, cell_m, x, y, yaw, body)
    for n in range(1, steps + 1):
        turn = step_m * curvature_1pm
        x += step_m * math.cos(yaw + turn / 2.0)
        y += step_m * math.sin(yaw + turn / 2.0)
        yaw += turn
        free = is_free(occupied, distance_m, cell_m, x, y, yaw, body)
        if free:
            touches = False
        elif not touches:
            return n * abs(step_m)
    return 0.0 if touches else math.inf
