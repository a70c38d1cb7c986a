"""What a car drives on that has no saved map: the map that it is making, in the frame of its own start.

Space that nobody has seen yet may be driven on: plans lead through it, and where a wall comes into sight on the way the
car stops and plans again on the larger map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.relocalisation import Located
from mapping.slam import MappedScan
from planning.costmap import UnknownSpace
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.map_of_today import Place, Sight, near_costmap

FloatArray = NDArray[np.float64]
GridNow = Callable[[], OccupancyGrid]

_AROUND_M = 3.0  # of nobody's space around what is known and the goals, for ways that lead outside
_ROOM_M = (0.15, 0.08)  # to keep from walls of which only an edge may be known yet, where there is so much
_NO_WALL = -1.0  # log-odds
_SPREAD = np.diag([0.02, 0.02, 0.01]) ** 2  # of a pose on the map that it was made with


def exploring(settings: AutopilotSettings) -> AutopilotSettings:
    """Return settings with which a car drives into space that it has not seen."""
    margins_m = tuple(sorted({*_ROOM_M, *settings.margins_m}, reverse=True))
    unknown = UnknownSpace.costly if settings.unknown is UnknownSpace.forbidden else settings.unknown
    return replace(settings, margins_m=margins_m, unknown=unknown)


class GrowingGround:
    """See tools.map_of_today.Ground. grid_now: the map with all scans so far, called in the thread that maps.

    goals (3,) in the map frame, around which the ground reaches too.
    """

    def __init__(
        self, grid_now: GridNow, vehicle: Vehicle, settings: AutopilotSettings, goals: Sequence[FloatArray]
    ) -> None:
        self._grid_now, self._settings = grid_now, settings
        self._vehicle = replace(vehicle, margin_m=0.0)
        self._goals = np.array(goals, dtype=np.float64).reshape(-1, 3)[:, :2]

    def add(self, mapped: MappedScan) -> Sight | None:
        """Take in a scan that is on the map by now; None where it could not be matched, no place after a loss."""
        if not mapped.match.accepted:
            return None
        if not mapped.in_map:
            return Sight(None, "tracking was lost, and this place is not tied to the map yet")
        reason = "on the map that is being made"
        located = Located(mapped.stamp_ns, mapped.pose, mapped.T_map_odom, _SPREAD, 1.0, reason)
        known = self._grid_now()
        body = se2.transform_points(mapped.pose, self._vehicle.body)
        grid = reaching(known, np.vstack([self._goals, mapped.pose[np.newaxis, :2]]), _AROUND_M, body)
        near = near_costmap(grid, mapped.pose, self._vehicle, self._settings)
        return Sight(Place(located, near, grid), reason)


def reaching(grid: OccupancyGrid, places: FloatArray, around_m: float, body: FloatArray) -> OccupancyGrid:
    """Return the map with unknown cells around: so much around the grid, and around places (N, 2) of its frame.

    The cells that the corners (M, 2) of a convex body enclose are no wall: it could not stand there else. Walls are
    drawn as wide as cells and as thick as poses are uncertain; a car beside one would seem to be in it.
    """
    import cv2

    rows, cols = grid.log_odds.shape
    around = around_m / grid.resolution_m
    at = np.vstack([grid.cell_coordinates(np.vstack([places, body])), [[0.0, 0.0], [cols, rows]]])
    low, high = np.floor(at.min(axis=0) - around).astype(int), np.ceil(at.max(axis=0) + around).astype(int)
    cells = np.zeros((high[1] - low[1], high[0] - low[0]), np.float32)
    cells[-low[1] : rows - low[1], -low[0] : cols - low[0]] = grid.log_odds
    corners = np.floor(grid.cell_coordinates(body)).astype(np.int32) - low.astype(np.int32)
    cv2.fillConvexPoly(cells, corners, (_NO_WALL,))
    corner = np.array([*(low * grid.resolution_m), 0.0])
    return OccupancyGrid(cells, grid.resolution_m, se2.compose(grid.origin, corner))
