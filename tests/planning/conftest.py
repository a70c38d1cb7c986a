"""A small building to drive in: two rooms and a door."""

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
