"""What a scan tells the autopilot, put together apart from driving: the place, and the map of today around it.

Matching and mapping take tens of milliseconds; what they come to is one object that never changes, which a thread that
drives can take up at any time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.changing_map import ChangingMap
from mapping.grid import OccupancyGrid
from mapping.relocalisation import Located
from mapping.sensor_models import LidarModel
from mapping.slam import MappedScan
from planning.costmap import Costmap, costmap
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.locating import Locating

FloatArray = NDArray[np.float64]

_MOVED_M = 0.5  # that a car may have driven since a scan
_OCCUPIED = 5.0  # log-odds


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where the car was at a scan, what stood around it (near), and the whole map as it was known then.

    near: the part of the map in which the car drives before it looks again; its vehicle has no margin.
    """

    located: Located
    near: Costmap
    grid: OccupancyGrid

    @property
    def stamp_s(self) -> float:
        """When the scan was made."""
        return self.located.stamp_ns * 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What the last scan told; place None: the car does not know where it is, reason says why."""

    place: Place | None
    reason: str


class Ground(Protocol):
    """What the car drives on: a saved map, or one that is being made."""

    def add(self, mapped: MappedScan) -> Sight | None:
        """Take in a scan; None where it tells nothing new."""
        ...


class SavedGround:
    """A saved map that learns what is different today; guess (3,): where about the car stands, None: nobody knows.

    sensor (2,): the laser's place on the body.
    """

    def __init__(
        self,
        saved: OccupancyGrid,
        vehicle: Vehicle,
        sensor: FloatArray,
        settings: AutopilotSettings,
        guess: FloatArray | None,
    ) -> None:
        self._locating = Locating(saved, guess, sensor, settings.tracking)
        self._map = ChangingMap(saved, LidarModel(max_range_m=settings.obstacle_range_m))
        self._grid = self._map.grid()
        self._vehicle, self._sensor, self._settings = replace(vehicle, margin_m=0.0), sensor, settings

    def add(self, mapped: MappedScan) -> Sight | None:
        """Take in a scan; None where it could not be matched."""
        if not mapped.match.accepted:
            return None
        located = self._locating.add(mapped)
        if located is None:
            return Sight(None, self._locating.reason)
        points = se2.transform_points(located.T_map_base, mapped.points)
        laser = se2.transform_points(located.T_map_base, self._sensor)
        if located.by_odometry:  # what is measured now counts for this moment, and the map does not learn from it
            far = np.hypot(*(points - laser).T) > self._settings.obstacle_range_m
            here = with_points(self._grid, points[~far])
        else:
            if self._map.add_scan(laser, points) is not None:
                self._grid = self._map.grid()
            here = self._grid
        near = near_costmap(here, located.T_map_base, self._vehicle, self._settings)
        return Sight(Place(located, near, self._grid), self._locating.reason)


def near_costmap(grid: OccupancyGrid, pose: FloatArray, vehicle: Vehicle, settings: AutopilotSettings) -> Costmap:
    """Return the costmap of the part of a map, cut at whole cells, in which a car at a pose (3,) looks ahead."""
    around_m = settings.check_m + vehicle.outer_radius_m + _MOVED_M
    cells = math.ceil(around_m / grid.resolution_m)
    rows, cols = grid.log_odds.shape
    col, row = np.floor(grid.cell_coordinates(pose[np.newaxis, :2])[0]).astype(int).tolist()
    left, top = (min(max(low - cells, 0), most - 1) for low, most in ((col, cols), (row, rows)))
    right, bottom = (max(min(high + cells, most), 1) for high, most in ((col, cols), (row, rows)))
    corner = np.array([left * grid.resolution_m, top * grid.resolution_m, 0.0])
    part = grid.log_odds[top:bottom, left:right]
    cut = OccupancyGrid(part, grid.resolution_m, se2.compose(grid.origin, corner))
    return costmap(cut, vehicle, settings.unknown)


def with_points(grid: OccupancyGrid, points: FloatArray) -> OccupancyGrid:
    """Return a map on which points (N, 2) stand, apart from those beside a wall that is there: they are the wall."""
    import cv2

    cells = grid.log_odds.copy()
    near_wall = cv2.dilate(grid.occupied.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    col, row = np.floor(grid.cell_coordinates(points)).astype(int).T
    inside = (row >= 0) & (col >= 0) & (row < cells.shape[0]) & (col < cells.shape[1])
    row, col = row[inside], col[inside]
    new = ~near_wall[row, col]
    cells[row[new], col[new]] = _OCCUPIED
    return OccupancyGrid(cells, grid.resolution_m, grid.origin)
