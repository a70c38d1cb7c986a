"""Images of whole maps: the three states, bicubic rescaling in place, and turns that points can follow."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.occupancy_image import FREE, OCCUPIED, UNKNOWN, free_image, occupancy_image, rescale_bicubic, turn_nearest
from mapping.grid import OccupancyGrid


def test_each_cell_is_what_it_is_more_probably():
    grid = OccupancyGrid(np.array([[0.01, -0.01, 0.0], [6.0, -6.0, -3.0]], np.float32), 0.1, np.zeros(3))
    assert occupancy_image(grid).tolist() == [[OCCUPIED, FREE, UNKNOWN], [OCCUPIED, FREE, FREE]]
    assert free_image(grid, 0.5).tolist() == [[0, 255, 0], [0, 255, 255]]
    assert free_image(grid, 0.99).tolist() == [[0, 0, 0], [0, 255, 0]]


def test_rescaling_leaves_edges_where_they_are():
    image = np.zeros((40, 60), np.uint8)
    image[:, 24:] = 255  # an edge at 2.4 m
    for cells_per_meter in (4.0, 25.0):
        rescaled = rescale_bicubic(image, 0.1, 1.0 / cells_per_meter)
        assert rescaled.shape == (round(4.0 * cells_per_meter), round(6.0 * cells_per_meter))
        edge = np.interp(127.5, np.sort(rescaled[0].astype(float)), np.arange(rescaled.shape[1]) + 0.5)
        assert edge / cells_per_meter == pytest.approx(2.4, abs=0.3 / cells_per_meter)


def test_rescaling_there_and_back_gives_nearly_the_same_image():
    image = np.kron(np.random.default_rng(1).integers(0, 2, (12, 9)), np.full((8, 8), 255)).astype(np.uint8)
    back = rescale_bicubic(rescale_bicubic(image, 0.1, 0.04), 0.04, 0.1)
    assert back.shape == image.shape
    assert np.mean(np.abs(back.astype(int) - image) > 60) < 0.02
    assert rescale_bicubic(image, 0.1, 0.1) is image


@pytest.mark.parametrize("turn_deg", [0.0, 37.0, 90.0, -120.0, 180.0])
def test_a_point_turns_with_the_image_about_its_middle(turn_deg):
    image = np.zeros((60, 100), np.uint8)
    image[10:13, 80:83] = 255  # its middle is at x 81.5, y 11.5
    turned = turn_nearest(image, np.radians(turn_deg))
    rows, cols = np.nonzero(turned)
    found = np.array([cols.mean() + 0.5, rows.mean() + 0.5]) - np.array(turned.shape[::-1]) / 2.0
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    expected = np.array([[c, -s], [s, c]]) @ (np.array([81.5, 11.5]) - np.array([50.0, 30.0]))
    assert np.abs(found - expected).max() < 0.75
    assert abs(np.count_nonzero(turned) - 9) <= 3


def test_no_turn_and_right_angles_move_no_cell_between_others():
    image = np.random.default_rng(2).integers(0, 256, (31, 44), np.uint8)
    assert (turn_nearest(image, 0.0) == image).all()
    assert (turn_nearest(image, np.pi) == image[::-1, ::-1]).all()
