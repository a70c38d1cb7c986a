"""A floor plan drawn cell by cell, and views of it as two robots would have mapped it."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from fusion.resampling import raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid

RESOLUTION_M = 0.05
Viewer = Callable[..., OccupancyGrid]


def draw_building(seed: int = 7) -> OccupancyGrid:
    """30 m x 18 m of rooms of different size along a corridor, with doors and furniture."""
    random = np.random.default_rng(seed)
    image = np.full((360, 600), 255, np.uint8)
    walls = [((0, 0), (599, 0)), ((0, 359), (599, 359)), ((0, 0), (0, 359)), ((599, 0), (599, 359))]
    walls += [((0, 150), (599, 150)), ((0, 195), (599, 195))]
    walls += [((x, 0), (x, 150)) for x in (95, 170, 300, 390, 520)] + [((x, 195), (x, 359)) for x in (130, 220, 420)]
    for start, end in walls:
        cv2.line(image, start, end, 0, 2)
    for x in (40, 130, 240, 345, 450, 560):
        cv2.line(image, (x, 150), (x + 18, 150), 255, 3)
    for x in (60, 170, 300, 500):
        cv2.line(image, (x, 195), (x + 18, 195), 255, 3)
    for _ in range(60):
        x, y, width, height = random.integers([5, 5, 4, 4], [590, 350, 22, 22]).tolist()
        if not 140 < y + height < 210:
            cv2.rectangle(image, (x, y), (x + width, y + height), 0, 2)
    return OccupancyGrid(np.where(image > 0, -5.0, 5.0).astype(np.float32), RESOLUTION_M, np.zeros(3))


@pytest.fixture(scope="session")
def building() -> OccupancyGrid:
    """The whole floor, without noise."""
    return draw_building()


@pytest.fixture(scope="session")
def view(building: OccupancyGrid) -> Viewer:
    """A function that maps x from low_m to high_m of the building in a frame of its own, with noise of its own."""

    def make(
        low_m: float, high_m: float, T_map_building: np.ndarray, seed: int, resolution_m: float = RESOLUTION_M
    ) -> OccupancyGrid:
        corners = np.array([(low_m, 0.0), (high_m, 0.0), (high_m, 18.0), (low_m, 18.0)])
        raster = raster_around(se2.transform_points(T_map_building, corners), resolution_m)
        cells = resample(building, T_map_building, raster)
        grid = OccupancyGrid(cells, resolution_m, raster.origin)
        rows, cols = np.indices(cells.shape)
        centers = se2.transform_points(se2.inverse(T_map_building), grid.cell_centers(rows.ravel(), cols.ravel()))
        outside = ((centers[:, 0] < low_m) | (centers[:, 0] > high_m)).reshape(cells.shape)
        random = np.random.default_rng(seed)
        lost = random.random(cells.shape) < 0.01
        strength = random.uniform(0.6, 1.0, cells.shape)
        noisy = np.where(outside | lost, 0.0, cells * strength).astype(np.float32)
        return OccupancyGrid(noisy, resolution_m, raster.origin)

    return make
