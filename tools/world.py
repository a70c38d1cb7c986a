"""The world that emulated sensors look at: a grid of walls, from a map file or a built-in building."""

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

BUILT_RESOLUTION_M = 0.02
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

# Two wings of a building, 19 by 12 m, given as the office: rooms and a corridor each, a hall between them (x 8 to 13).
# The office will not do for two cars that share a third: turned by half a turn about its middle it is nearly the same,
# so that the rooms of one end fit on those of the other better than the corridor on itself.
_WINGS_SIZE_M = (19.0, 12.0)
_WINGS_WALLS = (
    (0.0, 0.0, 19.0, 0.0), (19.0, 0.0, 19.0, 12.0), (19.0, 12.0, 0.0, 12.0), (0.0, 12.0, 0.0, 0.0),
    (0.0, 4.6, 3.2, 4.6), (4.2, 4.6, 8.0, 4.6), (0.0, 6.2, 1.6, 6.2), (2.6, 6.2, 5.7, 6.2), (6.7, 6.2, 8.0, 6.2),
    (5.2, 0.0, 5.2, 4.6), (4.2, 6.2, 4.2, 9.2), (4.2, 10.2, 4.2, 12.0), (0.0, 10.6, 1.4, 12.0),
    (8.0, 0.0, 8.0, 4.9), (8.0, 5.9, 8.0, 12.0), (8.0, 4.0, 13.0, 4.0), (11.3, 4.0, 13.0, 5.7), (8.0, 9.0, 13.4, 9.0),
    (13.0, 0.0, 13.0, 1.2), (13.0, 2.2, 13.0, 6.9), (13.0, 7.9, 13.0, 9.0),
    (14.6, 0.0, 14.6, 2.6), (14.6, 3.6, 14.6, 5.6), (14.6, 6.6, 14.6, 9.0), (14.4, 9.0, 16.2, 9.0),
    (17.2, 9.0, 19.0, 9.0), (14.6, 4.4, 19.0, 4.4), (10.2, 9.0, 10.2, 12.0), (17.6, 0.0, 19.0, 1.4),
)  # fmt: skip
_WINGS_BOXES = (
    (2.2, 2.2, 3.2, 3.0), (0.1, 0.1, 0.7, 1.4), (1.5, 8.4, 2.4, 9.6), (5.9, 8.2, 6.8, 9.0), (7.2, 11.2, 7.9, 11.9),
    (0.1, 4.8, 0.5, 5.4), (8.1, 7.8, 9.3, 8.9), (9.2, 4.1, 10.2, 4.6), (15.4, 10.2, 16.4, 10.7), (18.3, 6.0, 18.9, 7.6),
    (15.6, 4.5, 16.8, 5.0), (14.7, 0.1, 15.3, 1.0), (12.2, 11.3, 13.2, 11.9), (13.1, 0.1, 13.6, 0.8),
)  # fmt: skip
_WINGS_PILLARS = ((10.6, 7.4, 0.3), (17.2, 6.6, 0.25), (5.2, 11.2, 0.2), (3.6, 1.0, 0.2))
# Drives of two cars that start in the two wings. Each explores three rooms of its own; they meet in the hall, about a
# third of the free space of either map.
WINGS_WEST_TOUR = (
    (1.2, 1.6), (1.3, 2.6), (2.0, 3.5), (3.0, 3.6), (3.6, 4.2), (3.5, 5.0), (2.8, 5.5), (2.2, 6.1), (1.9, 6.8),
    (1.0, 7.8), (0.85, 9.2), (1.5, 10.2), (2.8, 10.1), (4.2, 9.7), (5.2, 9.6), (6.3, 9.6), (7.2, 9.2), (7.3, 8.1),
    (6.6, 7.1), (6.2, 6.3), (6.5, 5.6), (7.3, 5.4), (8.3, 5.4), (9.4, 5.6), (10.5, 5.9), (11.3, 6.3),
)  # fmt: skip
WINGS_EAST_TOUR = (
    (18.1, 1.9), (17.1, 2.1), (15.9, 2.8), (14.6, 3.1), (13.9, 3.7), (13.7, 5.0), (13.8, 6.5), (13.8, 8.0), (13.9, 9.2),
    (14.4, 10.2), (15.0, 11.0), (16.0, 11.3), (16.9, 11.0), (17.1, 10.2), (16.8, 9.2), (16.4, 8.0), (16.1, 6.8),
    (15.4, 6.2), (14.5, 6.1), (14.0, 6.4), (13.75, 7.0), (13.5, 7.45), (12.9, 7.5), (12.2, 7.2), (11.5, 6.7),
    (10.8, 6.3), (10.0, 5.9),
)  # fmt: skip
# What a drive is called: the world that it goes through, and its waypoints.
TOURS = {
    "office": ("office", OFFICE_TOUR),
    "wings-west": ("wings", WINGS_WEST_TOUR),
    "wings-east": ("wings", WINGS_EAST_TOUR),
}


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Walls as a boolean grid (rows, cols), row 0 at the lowest y; origin (3,) as in an OccupancyGrid."""

    occupied: NDArray[np.bool_]
    resolution_m: float
    origin: FloatArray

    def objection(self, x_m: float, y_m: float) -> str | None:
        """Return why no car can stand with its middle there; None where one can, walls near it or not."""
        rows, cols = self.occupied.shape
        col, row = np.floor(
            se2.transform_points(se2.inverse(self.origin), np.array([[x_m, y_m]]))[0] / self.resolution_m
        )
        if not (0 <= col < cols and 0 <= row < rows):
            corners = np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)]) * self.resolution_m
            (left, below), (right, above) = (
                bound(se2.transform_points(self.origin, corners), axis=0).tolist() for bound in (np.min, np.max)
            )
            return f"outside of the world: x {left:.2f} to {right:.2f} m, y {below:.2f} to {above:.2f} m"
        return "in a wall" if self.occupied[int(row), int(col)] else None

    def ranges(self, poses: FloatArray, bearings_rad: FloatArray, max_range_m: float) -> FloatArray:
        """Return the distance in m (N,) to the first wall from sensor poses (N, 3) along bearings (N,) in their frames.

        0 where there is none within max_range_m.
        """
        starts = se2.transform_points(se2.inverse(self.origin), poses[:, :2]) / self.resolution_m
        headings = poses[:, 2] + bearings_rad - self.origin[2]
        return cast_rays(self.occupied, starts, headings, max_range_m / self.resolution_m) * self.resolution_m


def office() -> World:
    """Return the built-in office, 16 by 11 m, with its lower-left corner at the origin."""
    return _built(_OFFICE_SIZE_M, _OFFICE_WALLS, _OFFICE_BOXES, _OFFICE_PILLARS)


def wings() -> World:
    """Return the built-in wings that share a hall, 19 by 12 m, with their lower-left corner at the origin."""
    return _built(_WINGS_SIZE_M, _WINGS_WALLS, _WINGS_BOXES, _WINGS_PILLARS)


BUILT_IN = {"office": office, "wings": wings}


def load_world(name: str) -> World:
    """Return a world of BUILT_IN by its name, or the walls of a map file; raise MapFileError if it cannot be read."""
    if name in BUILT_IN:
        return BUILT_IN[name]()
    grid = read_map(Path(name))
    return World(grid.occupied, grid.resolution_m, grid.origin)


def _built(
    size_m: tuple[float, float],
    walls: tuple[tuple[float, float, float, float], ...],
    boxes: tuple[tuple[float, float, float, float], ...],
    pillars: tuple[tuple[float, float, float], ...],
) -> World:
    """Draw a building; walls and boxes as x0, y0, x1, y1, pillars as x, y, radius, all in m."""
    margin = 0.5
    width, height = (round((size + 2 * margin) / BUILT_RESOLUTION_M) for size in size_m)
    image = np.zeros((height, width), np.uint8)

    def cell(x_m: float, y_m: float) -> tuple[int, int]:
        return round((x_m + margin) / BUILT_RESOLUTION_M), round((y_m + margin) / BUILT_RESOLUTION_M)

    for x0, y0, x1, y1 in walls:
        cv2.line(image, cell(x0, y0), cell(x1, y1), (1,), round(_WALL_M / BUILT_RESOLUTION_M))
    for x0, y0, x1, y1 in boxes:
        cv2.rectangle(image, cell(x0, y0), cell(x1, y1), (1,), cv2.FILLED)
    for x, y, radius in pillars:
        cv2.circle(image, cell(x, y), round(radius / BUILT_RESOLUTION_M), (1,), cv2.FILLED)
    return World(image.astype(np.bool_), BUILT_RESOLUTION_M, np.array([-margin, -margin, 0.0]))
