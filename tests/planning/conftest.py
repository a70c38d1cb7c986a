"""A small building to drive in, two rooms and a door, and a passage that no car gets through."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid

ORIGIN = np.array([-2.0, 1.0, 0.5])  # a map frame whose axes are not those of the cells
ROOM_M = (8.0, 6.0)


@pytest.fixture(scope="session")
def rooms() -> OccupancyGrid:
    """8 m x 6 m at 0.05 m: a wall at x = 4 m with a door of 1 m, and an unseen corner at the top right."""
    cells = np.full((120, 160), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, -1]] = 5.0
    cells[:, 80] = 5.0
    cells[50:70, 80] = -5.0
    cells[90:, 130:] = 0.0
    cells[20, 30] = 0.0  # a speck that no beam touched
    return OccupancyGrid(cells, 0.05, ORIGIN)


@pytest.fixture(scope="session")
def passage() -> OccupancyGrid:
    """0.6 m wide, with two walls across it, 0.2 m apart: the rear axle can pass their gaps, the car's body cannot."""
    cells = np.full((18, 60), 5.0, np.float32)
    cells[3:15, 2:58] = -5.0
    cells[7:15, 30] = cells[3:11, 34] = 5.0
    return OccupancyGrid(cells, 0.05, np.zeros(3))
