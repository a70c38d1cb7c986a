"""A saved map that goes on learning: what stands in the way today is marked, what is gone is cleared.

The saved evidence counts, but no more than a few scans can outweigh: it may be weeks old, and a box on the way is not
on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid
from mapping.raycast import integrate_rays
from mapping.reference_map import FREE_BELOW
from mapping.sensor_models import LidarModel
from mapping.surface import facings_of
from mapping.wall_faces import faces_towards, facing_layers
from mapping.wall_map import wall_map

FloatArray = NDArray[np.float64]
_SHORT_OF_WALL = 2.0  # cells


@dataclass(frozen=True, slots=True)
class Confidence:
    """How much a cell's evidence counts at most, in log-odds: free ones are taken up quickly, walls given up slowly.

    With the lidar's model 0.7 and 0.4, a free cell is occupied after 3 scans, a wall is gone after 7.
    """

    free: float = 1.2
    occupied: float = 3.0


class ChangingMap:
    """A grid of a saved map's size and place; sensor readings that end outside clear up to its edge only."""

    def __init__(self, saved: OccupancyGrid, model: LidarModel, confidence: Confidence = Confidence()) -> None:
        self._saved = saved
        self._model = model
        self._confidence = confidence
        self._log_odds = np.clip(saved.log_odds, -confidence.free, confidence.occupied).astype(np.float32)
        self._visited = np.zeros(self._log_odds.shape, np.int32)
        self._scans = 0
        faces = faces_towards(wall_map(saved, free_below=FREE_BELOW))
        around = np.ones((3, 3), np.uint8)
        self._near_wall = np.stack([cv2.dilate(layer.view(np.uint8), around) > 0 for layer in faces])

    def add_scan(self, sensor: FloatArray, points: FloatArray) -> tuple[int, int, int, int] | None:
        """Add points (N, 2) measured from sensor (2,), both in the map frame.

        Returns first row, first column, last row + 1 and last column + 1 of the cells that may have changed, None where
        the sensor is outside.
        """
        rows, cols = self._log_odds.shape
        start = self._saved.cell_coordinates(sensor[np.newaxis, :])[0]
        if len(points) == 0 or not ((start >= 0.0).all() and start[0] < cols and start[1] < rows):
            return None
        ends = self._saved.cell_coordinates(points)
        rays = ends - start
        ranges_m = np.hypot(rays[:, 0], rays[:, 1]) * self._saved.resolution_m
        share = np.minimum(self._share_inside(start, rays), self._model.max_range_m / np.maximum(ranges_m, 1e-9))
        is_hit = share >= 1.0
        ends = np.clip(start + rays * np.minimum(share, 1.0)[:, np.newaxis], 0.0, np.array([cols, rows]) - 1e-6)
        # A hit beside a saved wall is that wall: the place is known to a few centimetres only, and walls must not grow.
        # But only if it was seen from that side: the other face is new, a wall's thickness away.
        col, row = ends.astype(np.intp).T
        layers = facing_layers(facings_of(points, sensor) - self._saved.origin[2])
        on_wall = is_hit & self._near_wall[layers, row, col]
        is_hit &= ~on_wall
        lengths = np.hypot(*(ends - start).T)
        shortened = np.where(on_wall, np.maximum(lengths - _SHORT_OF_WALL, 0.0) / np.maximum(lengths, 1e-9), 1.0)
        ends = start + (ends - start) * shortened[:, np.newaxis]
        self._scans += 1
        hit = self._model.hit_log_odds(ranges_m, self._saved.resolution_m)
        low, high = np.vstack([ends, start]).min(axis=0), np.vstack([ends, start]).max(axis=0)
        left, top, right, bottom = int(low[0]), int(low[1]), math.ceil(high[0] + 1e-6), math.ceil(high[1] + 1e-6)
        miss, most = self._model.miss_log_odds, self._confidence.occupied
        integrate_rays(self._log_odds, self._visited, self._scans, start, ends, is_hit, hit, miss, most)
        part = self._log_odds[top:bottom, left:right]
        np.maximum(part, -self._confidence.free, out=part)
        return top, left, bottom, right

    def grid(self) -> OccupancyGrid:
        """Return the map as it is known now."""
        return OccupancyGrid(self._log_odds, self._saved.resolution_m, self._saved.origin)

    def _share_inside(self, start: FloatArray, rays: FloatArray) -> FloatArray:
        """Return the share (N,) of each ray (N, 2), in cells, that lies inside the grid; 1 or more for the whole."""
        rows, cols = self._log_odds.shape
        most = np.array([cols, rows], dtype=np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(rays > 0.0, (most - start) / rays, np.where(rays < 0.0, -start / rays, np.inf))
        return np.asarray(share.min(axis=1))
