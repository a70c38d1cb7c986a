from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from tools.map_overlay import COLORS_BGR, pixels_of, raster_for, view_of_both
from tools.map_panels import (
    MARK_BGR,
    OverlayMarks,
    draw_scale_bar,
    overlay_panel,
    score_panel,
    single_panel,
    two_peaks,
)

SHAPE = (300, 400)
ORANGE = COLORS_BGR["wall b"]


def room(rows=100, cols=160):
    """Free space of 0.05 m cells with a wall around and one across, which tells left from right."""
    cells = np.full((rows, cols), -4.0, np.float32)
    cells[[0, -1]] = 4.0
    cells[:, [0, cols // 4, -1]] = 4.0
    return OccupancyGrid(cells, 0.05, np.array([-1.0, 2.0, 0.1]))


def share(image, color):
    return float((image == np.array(color, np.uint8)).all(axis=2).mean())


def positions(image, color):
    """Pixels (N, 2), x and y, near a colour: lines are anti-aliased."""
    return np.argwhere(np.abs(image.astype(int) - color).sum(axis=2) < 40)[:, ::-1]


def test_right_and_wrong_pose_look_different():
    conflict, both = COLORS_BGR["conflict"], COLORS_BGR["wall both"]
    right = overlay_panel(room(), room(), se2.IDENTITY, SHAPE)
    wrong = overlay_panel(room(), room(), np.array([1.0, 0.7, 0.3]), SHAPE)
    assert share(right, conflict) == 0.0
    assert share(wrong, conflict) > 0.005
    assert share(right, both) > share(wrong, both)


def test_overlay_does_not_depend_on_where_the_frames_lie():
    """The pose moves with B's frame, so the picture stays."""
    grid, moved_by = room(), np.array([40.0, -30.0, 0.0])
    moved = OccupancyGrid(grid.log_odds, grid.resolution_m, se2.compose(moved_by, grid.origin))
    T_a_b = np.array([0.5, 0.25, 0.0])
    plain = overlay_panel(grid, grid, T_a_b, SHAPE)
    other = overlay_panel(grid, moved, se2.compose(T_a_b, se2.inverse(moved_by)), SHAPE)
    assert (plain != other).any(axis=2).mean() < 0.002  # rounding at the edges of cells


@pytest.mark.parametrize("direction_deg", [0.0, 60.0, 90.0, 150.0])
def test_the_slide_is_drawn_along_its_direction_to_scale(direction_deg):
    angle = math.radians(direction_deg)
    T_a_b = np.zeros(3)
    plain = overlay_panel(room(), room(), T_a_b, SHAPE, OverlayMarks(axes=False))
    image = overlay_panel(room(), room(), T_a_b, SHAPE, OverlayMarks(axes=False, slide=(angle, 1.5)))
    pixel_m = raster_for(view_of_both(room(), room(), T_a_b), SHAPE).resolution_m
    near = (np.abs(image.astype(int) - MARK_BGR).sum(axis=2) < 40).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(near)
    arrow = np.argwhere(labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]))[:, ::-1]  # the rest are letters
    along, across = arrow @ [math.cos(angle), -math.sin(angle)], arrow @ [math.sin(angle), math.cos(angle)]
    assert share(plain, MARK_BGR) == 0.0
    assert np.ptp(along) * pixel_m == pytest.approx(3.0, rel=0.1)
    assert np.ptp(across) < 30


def test_features_are_marked_where_they_are():
    point_a = np.array([[2.0, 4.0]])
    T_a_b = np.array([0.5, 0.2, 0.3])
    point_b = se2.transform_points(se2.inverse(T_a_b), point_a)
    marks = OverlayMarks(axes=False, points_a=point_a, points_b=point_b)
    marked = positions(overlay_panel(room(), room(), T_a_b, SHAPE, marks), MARK_BGR)
    expected = pixels_of(raster_for(view_of_both(room(), room(), T_a_b), SHAPE), point_a)[0]
    assert np.abs(marked.mean(axis=0) - expected).max() < 1.5


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (300.0, 300.0, 2.0)])
def test_axes_of_both_frames_are_always_in_the_picture(origin):
    grid = OccupancyGrid(room().log_odds, 0.05, np.array(origin))
    plain = overlay_panel(grid, grid, np.zeros(3), SHAPE, OverlayMarks(axes=False))
    marked = overlay_panel(grid, grid, np.zeros(3), SHAPE, OverlayMarks())
    for name in ("wall a", "wall b"):
        assert len(positions(marked, COLORS_BGR[name])) > len(positions(plain, COLORS_BGR[name])) + 20


def test_map_alone_is_outlined_where_the_other_one_saw_too():
    grid = room()
    cells = np.where(np.arange(160) < 80, grid.log_odds, 0.0).astype(np.float32)  # saw the left half
    half = OccupancyGrid(cells, 0.05, grid.origin)
    alone = single_panel(grid, SHAPE, ORANGE, None, None)
    apart = single_panel(grid, SHAPE, ORANGE, half, np.array([100.0, 0.0, 0.0]))
    outlined = positions(single_panel(grid, SHAPE, ORANGE, half, se2.IDENTITY), ORANGE)
    assert share(alone, ORANGE) == share(apart, ORANGE) == 0.0
    whole = positions(single_panel(grid, SHAPE, ORANGE, grid, se2.IDENTITY), ORANGE)
    assert np.ptp(outlined[:, 0]) == pytest.approx(np.ptp(whole[:, 0]) / 2.0, rel=0.1)


def test_where_a_tiny_map_lies_is_ringed():
    tiny = OccupancyGrid(np.full((4, 4), -4.0, np.float32), 0.05, np.zeros(3))
    large = OccupancyGrid(np.full((2000, 2000), -4.0, np.float32), 0.05, np.array([-50.0, -50.0, 0.0]))
    ring = positions(single_panel(large, SHAPE, ORANGE, tiny, np.array([10.0, 10.0, 0.0])), ORANGE)
    assert 20 <= np.ptp(ring[:, 0]) <= 40


def test_a_map_without_a_known_cell_says_so():
    nothing = OccupancyGrid(np.zeros((10, 10), np.float32), 0.05, np.zeros(3))
    image = single_panel(nothing, SHAPE, ORANGE, nothing, se2.IDENTITY)
    assert (image[120:180] < 100).any()


def test_two_peaks_are_the_highest_and_the_highest_elsewhere():
    score = np.zeros((40, 60))
    score[10, 12], score[11, 13], score[30, 50] = 5.0, 4.9, 4.0
    assert two_peaks(score) == [(10, 12), (30, 50)]
    score[30, 50] = 0.0
    assert two_peaks(score) == [(10, 12)]  # all else is flat
    assert two_peaks(np.ones((1, 1))) == [(0, 0)]


@pytest.mark.parametrize("shape", [(40, 60), (900, 700)])
def test_score_peaks_are_ringed_in_their_place(shape):
    """The ring's centre is the peak's place, whatever the size of the array."""
    score = np.zeros(shape)
    score[int(0.75 * shape[0]), int(0.25 * shape[1])] = 1.0
    image = score_panel(score, (-3.0, 3.0, -2.0, 2.0), (200, 300))
    ring = positions(image[20:120, :110], (0, 0, 0))
    assert len(ring) > 20
    assert np.abs(np.median(ring, axis=0) - [75, 50 - 20]).max() < 8.0


def test_a_score_without_any_value_is_drawn():
    assert score_panel(np.full((3, 5), np.nan), (0.0, 1.0, 0.0, 1.0), (100, 100)).shape == (100, 100, 3)


@pytest.mark.parametrize("pixel_m", [0.002, 0.05, 0.3, 4.0])
def test_scale_bar_is_as_long_as_it_says(pixel_m):
    image = np.full((60, 400, 3), 200, np.uint8)
    draw_scale_bar(image, pixel_m)
    row = (image[60 - 16] < 100).all(axis=1)
    length = 1 + int(np.argmin(row[np.argmax(row) :])) - 2
    round_m = np.array([0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500])
    assert np.abs(length * pixel_m - round_m).min() <= 3 * pixel_m
    assert length <= 400 / 3 + 3
