"""A world of walls with heights: what a camera sees of the plan that a lidar cuts through."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tools.world import World

FloatArray = NDArray[np.float64]

ROOM_HEIGHT_M = 2.5
_FURNITURE_M = (0.4, 1.2)
_LONGEST_FURNITURE_M = 3.0
_FLATTEST_FURNITURE_M = 0.2  # what is thinner is a wall
_FULL = 0.9  # a box fills this share of the rectangle around it; angles of walls and round pillars do not


@dataclass(frozen=True, slots=True, eq=False)
class SolidWorld:
    """A plan whose cells are solid from bottoms_m up to heights_m (rows, cols), in m above the floor (z = 0).

    A height of 0: nothing stands there. A bottom over 0: it hangs, as the top of a table does. resolution_m and origin
    (3,) as in the plan. The ceiling is at ROOM_HEIGHT_M everywhere.
    """

    heights_m: NDArray[np.float32]
    bottoms_m: NDArray[np.float32]
    resolution_m: float
    origin: FloatArray

    def cut(self, z_m: float) -> World:
        """Return the plan that a laser sees which turns at a height over the floor."""
        solid_there = (self.bottoms_m <= z_m) & (z_m < self.heights_m)
        return World(solid_there, self.resolution_m, self.origin)


def solid(world: World, seed: int = 0) -> SolidWorld:
    """Return the world with walls and pillars up to the ceiling and furniture 0.4 to 1.2 m high, chosen by the seed.

    Furniture is every connected block of cells that is a box of less than 3 m.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(world.occupied.astype(np.uint8), connectivity=8)
    heights = np.full(count, ROOM_HEIGHT_M, np.float32)
    heights[0] = 0.0
    random = np.random.default_rng(seed)
    for label in range(1, count):
        width, depth, cells = stats[label, cv2.CC_STAT_WIDTH : cv2.CC_STAT_AREA + 1].tolist()
        sides_m = sorted((width * world.resolution_m, depth * world.resolution_m))
        is_box = cells >= _FULL * width * depth
        if is_box and sides_m[0] >= _FLATTEST_FURNITURE_M and sides_m[1] <= _LONGEST_FURNITURE_M:
            heights[label] = random.uniform(*_FURNITURE_M)
    standing = heights[labels]
    return SolidWorld(standing, np.zeros_like(standing), world.resolution_m, world.origin)
