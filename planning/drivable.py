"""Where on a map the car may be: blocked cells, distances, and regions that it cannot leave."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.footprint import Distances, Mask, clearance_m, is_free
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]


class UnknownSpace(str, Enum):
    """What to do about cells that were not seen free.

    forbidden: keep off, except for specks smaller than the car, which a lidar leaves between its beams.
    """

    forbidden = "forbidden"
    free = "free"


@dataclass(frozen=True, slots=True, eq=False)
class DrivableMap:
    """A grid as one vehicle sees it.

    blocked, occupied (rows, cols); distances in m between the centres of cells, to the nearest blocked and the nearest
    occupied one (larger than the map where there is none); region (rows, cols): the car's rear axle can never pass from
    one number to another, 0 where it cannot be at all.
    """

    grid: OccupancyGrid
    vehicle: Vehicle
    occupied: Mask
    blocked: Mask
    to_occupied_m: Distances
    to_blocked_m: Distances
    region: NDArray[np.int32]

    def local(self, poses: FloatArray) -> FloatArray:
        """Return map-frame poses (..., 3) in the coordinates of `footprint`."""
        return se2.compose(se2.inverse(self.grid.origin), poses)

    def cell(self, pose: FloatArray) -> tuple[int, int] | None:
        """Return row and column of a map-frame pose (3,); None outside."""
        col, row = np.floor(self.grid.cell_coordinates(pose[np.newaxis, :2])[0]).tolist()
        rows, cols = self.blocked.shape
        return (int(row), int(col)) if 0 <= row < rows and 0 <= col < cols else None

    def fits(self, pose: FloatArray) -> bool:
        """Whether the car with its margin fits at a map-frame pose (3,)."""
        x, y, yaw = self.local(pose).tolist()
        return bool(is_free(self.blocked, self.to_blocked_m, self.grid.resolution_m, x, y, yaw, self.vehicle.grown))

    def all_fit(self, poses: FloatArray) -> bool:
        """Whether the car with its margin fits at each map-frame pose (N, 3)."""
        return all(self.fits(pose) for pose in poses)

    def clearance_m(self, poses: FloatArray) -> float:
        """Return the least distance in m of the car's body at poses (N, 3) to an occupied cell; inf without any."""
        arguments = (self.occupied, self.to_occupied_m, self.grid.resolution_m, self.local(poses))
        return float(clearance_m(*arguments, self.vehicle.body))


def drivable_map(grid: OccupancyGrid, vehicle: Vehicle, unknown: UnknownSpace) -> DrivableMap:
    """Work out where the car may be; a cell counts as seen free if it was so more often than not."""
    occupied = grid.occupied
    blocked = occupied
    if unknown is UnknownSpace.forbidden:
        blocked = occupied | _without_specks(~occupied & ~(grid.log_odds < 0.0), vehicle.area_m2 / grid.resolution_m**2)
    to_blocked_m = _distance_m(blocked, grid.resolution_m)
    to_occupied_m = to_blocked_m if blocked is occupied else _distance_m(occupied, grid.resolution_m)
    # Necessary for the rear axle anywhere in a cell: the nearest edge of the car to the nearest square. From centre to
    # centre that is half a cell more, and the axle may be half a diagonal nearer.
    bound_m = min(vehicle.grown) + (0.5 - np.sqrt(0.5)) * grid.resolution_m
    passable = (~blocked) & (to_blocked_m >= bound_m)
    _, region = cv2.connectedComponents(passable.astype(np.uint8), connectivity=8)
    return DrivableMap(grid, vehicle, occupied, blocked, to_occupied_m, to_blocked_m, np.asarray(region, np.int32))


def _without_specks(mask: Mask, least_cells: float) -> Mask:
    """Return the mask without its connected parts of fewer cells."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= least_cells
    large[0] = False  # the background
    return np.asarray(large[labels])


def _distance_m(mask: Mask, cell_m: float) -> Distances:
    if not mask.any():
        return np.full(mask.shape, 1e6, np.float32)
    cells = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells * cell_m, dtype=np.float32)
