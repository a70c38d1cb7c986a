"""Maps painted over each other."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.resampling import Raster
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.lettering import INK_BGR
from tools.placed_maps_picture import PlacedMap, corners_of, paint_maps

RED, BLUE = (0, 0, 255), (255, 0, 0)


def room(first: int) -> OccupancyGrid:
    """Free space with a wall of column `first`."""
    cells = np.full((20, 20), -3.0, np.float32)
    cells[:, first] = 3.0
    return OccupancyGrid(cells, 0.1, np.zeros(3))


@pytest.fixture
def raster():
    return Raster((20, 30), 0.1, np.zeros(3))


def test_walls_have_their_maps_colour_and_are_dark_where_both_saw_them(raster):
    maps = [PlacedMap(room(5), se2.IDENTITY, RED), PlacedMap(room(0), np.array([0.5, 0.0, 0.0]), BLUE)]
    for colors, tint in (((INK_BGR, INK_BGR), None), ((BLUE, BLUE), 0.2)):
        picture = np.full((20, 30, 3), 255, np.uint8)
        paint_maps(picture, raster, maps, tint=tint)
        assert tuple(picture[10, 5]) == colors[0]
    apart = [maps[0], PlacedMap(room(3), np.array([0.8, 0.0, 0.0]), BLUE)]
    picture = np.full((20, 30, 3), 255, np.uint8)
    paint_maps(picture, raster, apart)
    assert tuple(picture[10, 5]) == RED
    assert tuple(picture[10, 11]) == BLUE


def test_free_space_has_a_tint_mixed_where_both_saw_it(raster):
    maps = [PlacedMap(room(1), se2.IDENTITY, RED), PlacedMap(room(1), np.array([1.0, 0.0, 0.0]), BLUE)]
    picture = np.full((20, 30, 3), 255, np.uint8)
    paint_maps(picture, raster, maps, tint=0.5)
    only_red, both, only_blue = picture[10, 4], picture[10, 15], picture[10, 25]
    assert tuple(only_red) == (128, 128, 255)
    assert tuple(only_blue) == (255, 128, 128)
    assert both[1] < 128


def test_corners_are_those_of_the_walls_and_row_0_is_highest(raster):
    cells = np.full((20, 20), -3.0, np.float32)
    cells[2:6, 3:10] = 3.0
    placed = PlacedMap(OccupancyGrid(cells, 0.1, np.zeros(3)), se2.IDENTITY, RED)
    corners = corners_of([placed])
    np.testing.assert_allclose(corners.min(axis=0), [0.35, 0.25], atol=0.01)
    np.testing.assert_allclose(corners.max(axis=0), [0.95, 0.55], atol=0.01)
    picture = np.full((20, 30, 3), 255, np.uint8)
    paint_maps(picture, raster, [placed])
    assert tuple(picture[20 - 1 - 3, 5]) == RED
