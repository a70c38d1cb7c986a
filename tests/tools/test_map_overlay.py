from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import pytest

from fusion.resampling import Raster
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.map_overlay import (
    COLORS_BGR,
    overlay_image,
    pixels_of,
    raster_for,
    reduced,
    reduction,
    seen_on,
    view_of,
    view_of_both,
)

# Viénot, Brettel, Mollon (1999): how dichromats see linear RGB.
RED_BLIND = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]])
GREEN_BLIND = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])


def room(rows, cols, resolution_m=0.05, origin=(0.0, 0.0, 0.0)):
    """Free space with a wall of one cell all around."""
    cells = np.full((rows, cols), -4.0, np.float32)
    cells[[0, -1]] = 4.0
    cells[:, [0, -1]] = 4.0
    return OccupancyGrid(cells, resolution_m, np.array(origin))


def pixels(image, name):
    """(rows, cols) True where the picture, row 0 highest, has a colour of the legend."""
    return (image == np.array(COLORS_BGR[name], np.uint8)).all(axis=2)


@pytest.mark.parametrize("factor", [2, 3, 7, 40])
@pytest.mark.parametrize("shape", [(60, 60), (61, 35), (5, 100)])
def test_a_block_is_wall_if_any_cell_is_then_free_if_any_is(shape, factor):
    cells = np.random.default_rng(1).choice([0.0, -3.0, 3.0], shape, p=[0.5, 0.4, 0.1]).astype(np.float32)
    cells[:, :4] = 0.0
    small = reduced(OccupancyGrid(cells, 0.05, np.zeros(3)), factor)
    assert small.resolution_m == pytest.approx(0.05 * factor)
    for row, col in np.ndindex(small.log_odds.shape):
        block = cells[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor]
        expected = 1.0 if (block > 0).any() else -1.0 if (block < 0).any() else 0.0
        assert np.sign(small.log_odds[row, col]) == expected


def test_a_map_is_never_reduced_to_more_than_a_pixel():
    grid = room(100, 300)
    for pixel_m in (0.01, 0.05, 0.0999, 0.1, 0.33, 1e6):
        factor = reduction(grid, pixel_m)
        assert 1 <= factor <= 300
        assert factor == 1 or factor * 0.05 <= pixel_m + 1e-9
    assert reduction(grid, 0.1) == 2


@pytest.mark.parametrize("turn_deg", [0.0, 13.0, 45.0, 90.0, 181.0])
@pytest.mark.parametrize("pixel_m", [0.013, 0.05, 0.071, 0.4, 1.7])
def test_no_wall_is_lost_at_any_scale_and_turn(pixel_m, turn_deg):
    grid = room(420, 333, origin=(3.0, -2.0, 0.4))
    pose = np.array([5.0, 7.0, math.radians(turn_deg)])
    walls = se2.transform_points(pose, grid.cell_centers(*np.nonzero(grid.log_odds > 0)))
    low, high = walls.min(axis=0), walls.max(axis=0)
    cols, rows = (np.ceil((high - low) / pixel_m) + 4).astype(int).tolist()
    raster = Raster((rows, cols), pixel_m, np.array([*(low - 2 * pixel_m), 0.0]))
    seen = seen_on(grid, pose, raster)
    # A wall is in its own pixel, or, on reduced cells, in the next one.
    near = cv2.dilate((seen > 0).astype(np.uint8), np.ones((3, 3), np.uint8))
    col, row = np.floor((walls - raster.origin[:2]) / pixel_m).astype(int).T
    assert near[row, col].all()
    # The ring is closed: outside cannot be reached from inside.
    open_space = (seen <= 0).astype(np.uint8)
    labels = cv2.connectedComponents(open_space, connectivity=4)[1]
    middle = np.floor((low + high - 2 * raster.origin[:2]) / 2 / pixel_m).astype(int)
    assert labels[middle[1], middle[0]] != labels[0, 0]


def test_a_map_elsewhere_is_not_seen():
    raster = Raster((40, 50), 0.1, np.zeros(3))
    assert not seen_on(room(20, 20), np.array([900.0, -900.0, 1.0]), raster).any()


def test_a_map_laid_over_itself_contradicts_nothing_and_one_shifted_does():
    raster = Raster((120, 120), 0.05, np.array([-1.0, -1.0, 0.0]))
    one, other = seen_on(room(60, 60), se2.IDENTITY, raster), seen_on(room(60, 60), np.array([1.0, 0.0, 0.0]), raster)
    same = overlay_image(one, one, 0.05)
    assert {name for name in COLORS_BGR if pixels(same, name).any()} == {"unknown", "free both", "wall both"}
    shifted = overlay_image(one, other, 0.05)
    # In the middle row: A's wall, free in A, B's wall in A's free space, free in both, A's wall in B's, free in B.
    row = 120 - 20 - 30
    assert pixels(shifted, "wall a")[row, 20]
    assert pixels(shifted, "free a")[row, 30]
    assert pixels(shifted, "conflict")[row, 40]
    assert pixels(shifted, "free both")[row, 60]
    assert pixels(shifted, "conflict")[row, 79]
    assert pixels(shifted, "free b")[row, 90]
    assert pixels(shifted, "wall b")[row, 99]
    assert pixels(shifted, "unknown")[row, 5]


def test_exchanging_the_maps_exchanges_their_colours():
    raster = Raster((90, 110), 0.07, np.array([-1.0, -1.0, 0.0]))
    a, b = seen_on(room(60, 60), se2.IDENTITY, raster), seen_on(room(40, 50), np.array([1.0, 0.5, 0.7]), raster)
    image, exchanged = overlay_image(a, b, 0.07, 2), overlay_image(b, a, 0.07, 2)
    for name, other in (("free a", "free b"), ("free both", "free both"), ("conflict", "conflict")):
        assert np.array_equal(pixels(image, name), pixels(exchanged, other))


def test_walls_a_little_apart_are_one():
    raster = Raster((80, 80), 0.05, np.array([-0.5, -0.5, 0.0]))
    a, b = seen_on(room(60, 60), se2.IDENTITY, raster), seen_on(room(60, 60), np.array([0.1, 0.0, 0.0]), raster)
    image = overlay_image(a, b, 0.05)
    assert pixels(image, "wall both").any()
    assert not any(pixels(image, name).any() for name in ("wall a", "wall b", "conflict"))


@pytest.mark.parametrize("shape", [(100, 300), (300, 100), (17, 17)])
def test_raster_shows_the_whole_view_upright(shape):
    view = view_of(room(30, 80, origin=(4.0, -9.0, 0.3)))
    raster = raster_for(view, shape)
    assert raster.shape == shape
    corners = pixels_of(raster, np.vstack([view.low, view.high]))
    assert (corners > 0).all()
    assert (corners < shape[::-1]).all()
    assert corners[0, 0] < corners[1, 0]
    assert corners[0, 1] > corners[1, 1]  # y of the picture runs down


def test_view_leaves_the_unknown_rim_out():
    cells = np.zeros((200, 200), np.float32)
    cells[50:60, 100:130] = -3.0
    view = view_of(OccupancyGrid(cells, 0.1, np.array([1.0, 2.0, 0.0])))
    assert np.allclose(view.low, [11.0, 7.0])
    assert np.allclose(view.high, [14.0, 8.0])
    nothing = view_of(OccupancyGrid(np.zeros((20, 40), np.float32), 0.1, np.zeros(3)))
    assert np.allclose(nothing.high, [4.0, 2.0])


def test_view_holds_both_maps_unless_one_is_tiny_and_inside():
    large, small = room(400, 400), room(20, 20)
    pose = np.array([10.0, 5.0, 0.6])
    for a, b, T_a_b in ((large, small, pose), (small, large, se2.inverse(pose))):
        view = view_of_both(a, b, T_a_b)
        assert view.zoomed
        middle = np.array([[0.5, 0.5]]) if a is small else se2.transform_points(pose, np.array([[0.5, 0.5]]))
        assert np.allclose((view.low + view.high) / 2.0, middle[0])
        assert float((view.high - view.low).max()) < 4.0
    for T_a_b in (np.array([500.0, 0.0, 1.0]), np.array([0.0, -90.0, 1.0])):
        view = view_of_both(large, small, T_a_b)
        corners = se2.transform_points(T_a_b, np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float))
        assert not view.zoomed
        assert (view.low <= np.minimum(corners.min(axis=0), 0.0) + 1e-9).all()
        assert (view.high >= np.maximum(corners.max(axis=0), 20.0) - 1e-9).all()


@pytest.mark.parametrize("sight", [np.eye(3), RED_BLIND, GREEN_BLIND], ids=["full", "red-blind", "green-blind"])
def test_the_colour_blind_tell_the_colours_apart(sight):
    def lab(name):
        rgb = np.array(COLORS_BGR[name][::-1]) / 255.0
        seen = np.clip(sight @ rgb**2.2, 0.0, 1.0) ** (1 / 2.2)
        return cv2.cvtColor(seen.reshape(1, 1, 3).astype(np.float32), cv2.COLOR_RGB2Lab).ravel()

    walls = ("wall a", "wall b", "wall both", "conflict")
    for one, other in itertools.combinations(walls, 2):
        assert np.linalg.norm(lab(one) - lab(other)) > 25.0, (one, other)
    for one, other in itertools.combinations(("unknown", "free a", "free b", "free both"), 2):
        assert np.linalg.norm(lab(one) - lab(other)) > 8.0, (one, other)
