"""A map as one vehicle sees it: blocked cells, distances, regions that it cannot leave, and what cells cost a route."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning import costmap_layers as layers
from planning.footprint import Distances, Mask, clearance_m, is_free, poses_are_free
from planning.guide import Guide, make_guide
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]

_COSTLY = 1.0  # what a metre through unknown space costs a route on top, where that is allowed but unwanted
_FAR_M = 1e6


class UnknownSpace(str, Enum):
    """What to do about cells that were not seen free.

    forbidden: keep off, except for specks smaller than the car, which a lidar leaves between its beams. costly: routes
    lead through them only where the way around is twice as long.
    """

    forbidden = "forbidden"
    costly = "costly"
    free = "free"

    @property
    def route_cost(self) -> float:
        """What a metre through unknown space costs a route on top."""
        return _COSTLY if self is UnknownSpace.costly else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """A grid as one vehicle sees it; arrays are (rows, cols) and never written to, except by `costmap_update.update`.

    Distances in m are between the centres of cells, to the nearest occupied or blocked one, at most reach_m. The car's
    rear axle can never pass from one number of `region` to another; 0 where it cannot be at all, all numbers are below
    `regions`. route_cost: what a metre of a route costs in metres, 1 in the open, inf where the rear axle cannot be;
    guide has it on a coarser grid.
    """

    grid: OccupancyGrid
    vehicle: Vehicle
    unknown: UnknownSpace
    occupied: Mask
    blocked: Mask
    to_occupied_m: Distances
    to_blocked_m: Distances
    region: layers.Regions
    regions: int
    route_cost: NDArray[np.float32]
    guide: Guide

    @property
    def reach_m(self) -> float:
        """Up to where distances are known."""
        return layers.reach_m(self.vehicle)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the grid."""
        rows, cols = self.blocked.shape
        return cols * self.grid.resolution_m, rows * self.grid.resolution_m

    def local(self, poses: FloatArray) -> FloatArray:
        """Return map-frame poses (..., 3) in metres from the grid's lower-left corner, as `footprint` wants them."""
        return se2.compose(se2.inverse(self.grid.origin), poses)

    def world(self, poses: FloatArray) -> FloatArray:
        """Return local poses (..., 3) in the map frame."""
        return se2.compose(self.grid.origin, poses)

    def cell(self, pose: FloatArray) -> tuple[int, int] | None:
        """Return row and column of a map-frame pose (3,); None outside."""
        col, row = np.floor(self.grid.cell_coordinates(pose[np.newaxis, :2])[0]).tolist()
        rows, cols = self.blocked.shape
        return (int(row), int(col)) if 0 <= row < rows and 0 <= col < cols else None

    def fits(self, pose: FloatArray) -> bool:
        """Whether the car with its margin fits at a map-frame pose (3,)."""
        x, y, yaw = self.local(pose).tolist()
        arguments = (self.blocked, self.to_blocked_m, self.grid.resolution_m, x, y, yaw, self.vehicle.corners)
        return bool(is_free(*arguments))

    def all_fit(self, poses: FloatArray) -> bool:
        """Whether the car with its margin fits at each map-frame pose (N, 3)."""
        return self.first_misfit(poses) is None

    def first_misfit(self, poses: FloatArray) -> int | None:
        """Return the number of the first map-frame pose (N, 3) at which the car with its margin does not fit."""
        local = np.ascontiguousarray(self.local(poses))
        arguments = (self.blocked, self.to_blocked_m, self.grid.resolution_m, local, self.vehicle.corners)
        number = int(poses_are_free(*arguments))
        return None if number < 0 else number

    def clearance_m(self, poses: FloatArray) -> float:
        """Return the least distance in m of the car's body at map-frame poses (N, 3), N >= 1, to an occupied cell.

        inf without any such cell.
        """
        local, cell_m = np.ascontiguousarray(self.local(poses)), self.grid.resolution_m
        body, around_m = self.vehicle.body, self.vehicle.outer_radius_m
        best = float(clearance_m(self.occupied, self.to_occupied_m, cell_m, local, body))
        known_m = self.reach_m - around_m - 2.0 * cell_m
        part, whole = self.occupied[:0, :0], self.occupied.shape
        while best > known_m and part.shape != whole:  # distances are cut off: take true ones, of a part that grows
            known_m = 4.0 * (known_m + around_m)
            low = np.floor((local[:, :2].min(axis=0) - known_m - around_m) / cell_m).astype(int)
            high = np.ceil((local[:, :2].max(axis=0) + known_m + around_m) / cell_m).astype(int)
            low = np.clip(low, 0, [whole[1] - 1, whole[0] - 1])
            part = np.ascontiguousarray(
                self.occupied[low[1] : max(high[1], low[1] + 1), low[0] : max(high[0], low[0] + 1)]
            )
            moved = local - np.array([*low * cell_m, 0.0])
            best = float(clearance_m(part, layers.distances_m(part, cell_m, _FAR_M), cell_m, moved, body))
        return best


def costmap(grid: OccupancyGrid, vehicle: Vehicle, unknown: UnknownSpace) -> Costmap:
    """Work out where the car may be; a cell counts as seen free if it was so more often than not."""
    cell_m, reach_m = grid.resolution_m, layers.reach_m(vehicle)
    occupied, unseen = layers.occupied_and_unseen(grid.log_odds)
    blocked = occupied
    if unknown is UnknownSpace.forbidden:
        blocked = occupied | layers.without_specks(unseen, layers.least_cells(vehicle, cell_m))
    to_blocked_m = layers.distances_m(blocked, cell_m, reach_m)
    to_occupied_m = to_blocked_m if blocked is occupied else layers.distances_m(occupied, cell_m, reach_m)
    passable_m = layers.passable_from_m(vehicle, cell_m)
    regions, region = layers.connected(to_blocked_m >= passable_m)
    costs = layers.route_costs(to_blocked_m, unseen, passable_m, vehicle.inradius_m, unknown.route_cost)
    guide = make_guide(costs, to_blocked_m, cell_m, vehicle)
    return Costmap(
        grid, vehicle, unknown, occupied, blocked, to_occupied_m, to_blocked_m, region, regions, costs, guide
    )
