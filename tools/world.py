"""The world that emulated sensors look at: a grid of walls, from a map file or the built-in office."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.map_io import read_map
from mapping.raycast import cast_rays

FloatArray = NDArray[np.float64]

OFFICE_RESOLUTION_M = 0.02
_OFFICE_SIZE_M = (16.0, 11.0)
_WALL_M = 0.12

# Walls of the office as x0, y0, x1, y1 in metres: six rooms along a corridor (y 5.0 to 6.5), doors of 1.0 m.
# Nothing is symmetric, so that a mirrored or transposed map cannot pass for a right one.
_OFFICE_WALLS = (
    (0.0, 0.0, 16.0, 0.0), (16.0, 0.0, 16.0, 11.0), (16.0, 11.0, 0.0, 11.0), (0.0, 11.0, 0.0, 0.0),
    (0.0, 6.5, 2.2, 6.5), (3.2, 6.5, 6.6, 6.5), (7.6, 6.5, 11.0, 6.5), (12.0, 6.5, 16.0, 6.5),
    (0.0, 5.0, 4.2, 5.0), (5.2, 5.0, 8.4, 5.0), (9.4, 5.0, 13.2, 5.0), (14.2, 5.0, 16.0, 5.0),
    (5.0, 6.5, 5.0, 8.4), (5.0, 9.4, 5.0, 11.0), (9.5, 6.5, 9.5, 11.0),
    (6.5, 0.0, 6.5, 5.0), (11.2, 0.0, 11.2, 1.4), (11.2, 2.4, 11.2, 5.0),
    (14.4, 0.0, 16.0, 1.6), (0.0, 9.8, 1.2, 11.0),
)  # fmt: skip
# Furniture as x0, y0, x1, y1 in metres.
_OFFICE_BOXES = (
    (1.3, 8.0, 2.5, 8.7), (7.0, 8.5, 7.9, 9.3), (9.6, 10.3, 10.9, 10.9), (14.9, 7.6, 15.9, 9.4),
    (2.5, 1.9, 3.9, 2.7), (0.1, 0.1, 0.6, 1.6), (5.8, 3.0, 6.4, 4.2), (8.3, 1.6, 9.4, 2.6),
    (12.9, 2.0, 13.5, 3.3), (15.3, 3.4, 15.9, 4.9), (0.1, 5.1, 0.5, 5.6), (10.2, 6.1, 10.8, 6.4),
)  # fmt: skip
_OFFICE_PILLARS = ((12.6, 8.9, 0.35), (5.6, 10.4, 0.2), (7.3, 0.7, 0.25))  # x, y, radius in metres

# A drive through the office as x, y in metres, for a car that turns on 0.44 m at the least.
OFFICE_TOUR = (
    (1.6, 3.6), (3.0, 3.6), (4.4, 4.0), (4.9, 5.1), (5.8, 5.7), (8.0, 5.8), (10.2, 5.5), (11.3, 6.1), (11.6, 7.1),
    (11.5, 8.6), (11.9, 9.8), (13.1, 9.9), (13.8, 8.8), (13.2, 7.7), (12.0, 7.2), (11.4, 6.4), (10.6, 5.7), (9.0, 5.7),
    (8.1, 5.8), (7.4, 6.2), (7.0, 6.9), (6.7, 7.7), (6.0, 8.5), (5.0, 8.9), (3.9, 9.2), (2.9, 9.4), (1.6, 9.3),
    (0.9, 8.5), (1.3, 7.5), (2.3, 7.1), (2.9, 6.2), (3.9, 5.7), (5.6, 5.75), (7.4, 5.75),
)  # fmt: skip
# Drives of two cars that start in different rooms, at other headings. Each explores three rooms of its own and both see
# the corridor where they meet: about a third of the free space of either map, and some 20 m of wall.
OFFICE_WEST_TOUR = (
    (1.3, 0.9), (2.6, 0.95), (4.0, 1.1), (4.9, 2.0), (4.9, 3.4), (4.75, 4.6), (4.3, 5.5), (3.3, 6.0), (2.7, 6.6),
    (2.5, 7.3), (1.6, 7.4), (0.95, 8.2), (1.2, 9.1), (2.4, 9.4), (3.6, 9.2), (4.4, 8.9), (5.4, 8.9), (6.3, 8.4),
    (6.7, 7.8), (7.05, 7.1), (6.95, 6.5), (6.4, 5.9), (5.6, 5.75), (3.8, 5.75),
)  # fmt: skip
OFFICE_EAST_TOUR = (
    (7.5, 3.6), (7.5, 2.4), (7.8, 1.5), (8.6, 1.1), (9.8, 1.2), (11.2, 1.9), (12.0, 2.2), (12.5, 3.2), (13.2, 4.2),
    (13.6, 5.0), (13.2, 5.6), (12.4, 5.9), (11.7, 6.3), (11.5, 7.2), (11.5, 8.5), (11.95, 9.6), (13.1, 9.8),
    (13.8, 8.8), (13.2, 7.7), (12.1, 7.2), (11.45, 6.3), (10.8, 5.75), (9.6, 5.75),
)  # fmt: skip
OFFICE_TOURS = {"office": OFFICE_TOUR, "office-west": OFFICE_WEST_TOUR, "office-east": OFFICE_EAST_TOUR}


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Walls as a boolean grid (rows, cols), row 0 at the lowest y; origin (3,) as in an OccupancyGrid."""

    occupied: NDArray[np.bool_]
    resolution_m: float
    origin: FloatArray

    def ranges(self, poses: FloatArray, bearings_rad: FloatArray, max_range_m: float) -> FloatArray:
        """Return the distance in m (N,) to the first wall from sensor poses (N, 3) along bearings (N,) in their frames.

        0 where there is none within max_range_m.
        """
        starts = se2.transform_points(se2.inverse(self.origin), poses[:, :2]) / self.resolution_m
        headings = poses[:, 2] + bearings_rad - self.origin[2]
        return cast_rays(self.occupied, starts, headings, max_range_m / self.resolution_m) * self.resolution_m


def office() -> World:
    """Return the built-in office, 16 by 11 m, with its lower-left corner at the origin."""
    margin = 0.5
    width, height = (round((size + 2 * margin) / OFFICE_RESOLUTION_M) for size in _OFFICE_SIZE_M)
    image = np.zeros((height, width), np.uint8)

    def cell(x_m: float, y_m: float) -> tuple[int, int]:
        return round((x_m + margin) / OFFICE_RESOLUTION_M), round((y_m + margin) / OFFICE_RESOLUTION_M)

    for x0, y0, x1, y1 in _OFFICE_WALLS:
        cv2.line(image, cell(x0, y0), cell(x1, y1), (1,), round(_WALL_M / OFFICE_RESOLUTION_M))
    for x0, y0, x1, y1 in _OFFICE_BOXES:
        cv2.rectangle(image, cell(x0, y0), cell(x1, y1), (1,), cv2.FILLED)
    for x, y, radius in _OFFICE_PILLARS:
        cv2.circle(image, cell(x, y), round(radius / OFFICE_RESOLUTION_M), (1,), cv2.FILLED)
    return World(image.astype(np.bool_), OFFICE_RESOLUTION_M, np.array([-margin, -margin, 0.0]))


def load_world(name: str) -> World:
    """Return the world called "office", or the walls of a map file; raise MapFileError if it cannot be read."""
    if name == "office":
        return office()
    grid = read_map(Path(name))
    return World(grid.occupied, grid.resolution_m, grid.origin)
