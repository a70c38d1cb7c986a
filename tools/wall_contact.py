"""Where the body of a car has room in a world, exactly: its outline against the squares of the walls' cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from planning.costmap_layers import distances_m, reach_m
from planning.footprint import is_free
from planning.vehicle import Vehicle
from tools.world import World

FloatArray = NDArray[np.float64]


class Room:
    """Call it for whether a convex body, by default a QCar's, fits at a pose (3,) of the world; touching is fitting."""

    def __init__(self, world: World, vehicle: Vehicle | None = None) -> None:
        car = vehicle or Vehicle()
        self._origin = se2.inverse(world.origin)
        self._walls, self._cell_m, self._body = world.occupied, world.resolution_m, car.body
        self._to_wall_m = distances_m(world.occupied, world.resolution_m, reach_m(car))

    def __call__(self, pose: FloatArray) -> bool:
        """Whether it fits."""
        x, y, yaw = se2.compose(self._origin, pose).tolist()
        return bool(is_free(self._walls, self._to_wall_m, self._cell_m, x, y, yaw, self._body))
