"""A coarser grid to search routes on: cells pooled to a width that no wall fits into between two places of the car.

Each coarse cell stands for the roomiest of its fine ones, its anchor. Two places where the rear axle can be on both
sides of a wall lie twice its inradius apart, so cells of about that width still tell one side from the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.footprint import Distances
from planning.vehicle import Vehicle

Costs = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_SCRAPING_COST = 20.0  # on a metre where straight on the car's sides would touch


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """factor: fine cells in a coarse one's side. Of each coarse cell (R, C): cost of a metre in metres, inf where the
    rear axle cannot be; room_m, the anchor's distance to blocked cells; anchors (R, C, 2), its centre in local metres.
    """

    factor: int
    cost: Costs
    room_m: Distances
    anchors: FloatArray

    def cell(self, x: float, y: float, cell_m: float) -> tuple[int, int]:
        """Return row and column of local metres, for fine cells cell_m wide."""
        rows, cols = self.cost.shape
        width_m = self.factor * cell_m
        return min(max(int(y / width_m), 0), rows - 1), min(max(int(x / width_m), 0), cols - 1)


def make_guide(route_cost: Costs, distance_m: Distances, cell_m: float, vehicle: Vehicle) -> Guide:
    """Pool route_cost (rows, cols) by distance_m (rows, cols) to the nearest blocked cell."""
    factor = max(1, int(1.2 * vehicle.inradius_m / cell_m))
    rows, cols = -(-route_cost.shape[0] // factor), -(-route_cost.shape[1] // factor)
    cost, room_m = np.empty((rows, cols), np.float32), np.empty((rows, cols), np.float32)
    guide = Guide(factor, cost, room_m, np.empty((rows, cols, 2)))
    refresh_guide(guide, route_cost, distance_m, cell_m, vehicle, (0, 0, *route_cost.shape))
    return guide


def refresh_guide(
    guide: Guide,
    route_cost: Costs,
    distance_m: Distances,
    cell_m: float,
    vehicle: Vehicle,
    window: tuple[int, int, int, int],
) -> None:
    """Write the coarse cells of a window of fine cells anew: its first row and column, and those after its last."""
    factor, (top, left, bottom, right) = guide.factor, window
    part = (top // factor, left // factor, -(-bottom // factor), -(-right // factor))
    half_width_m = float(np.abs(vehicle.corners[:, 1]).max())
    scraping_m = half_width_m + cell_m / 2.0
    _pool(route_cost, distance_m, cell_m, factor, scraping_m, guide.cost, guide.room_m, guide.anchors, part)


@njit(cache=True, nogil=True)
def _pool(
    route_cost: Costs,
    distance_m: Distances,
    cell_m: float,
    factor: int,
    scraping_m: float,
    cost: Costs,
    room_m: Distances,
    anchors: FloatArray,
    part: tuple[int, int, int, int],
) -> None:
    rows, cols = route_cost.shape
    for row in range(part[0], part[2]):
        for col in range(part[1], part[3]):
            best_i, best_j, best = row * factor, col * factor, np.float32(-1.0)
            for i in range(row * factor, min((row + 1) * factor, rows)):
                for j in range(col * factor, min((col + 1) * factor, cols)):
                    if distance_m[i, j] > best:
                        best_i, best_j, best = i, j, distance_m[i, j]
            lack = min(max((scraping_m - best) / (0.4 * cell_m), 0.0), 1.0)
            cost[row, col] = route_cost[best_i, best_j] + _SCRAPING_COST * lack
            room_m[row, col] = best
            anchors[row, col, 0], anchors[row, col, 1] = (best_j + 0.5) * cell_m, (best_i + 0.5) * cell_m
