from __future__ import annotations

import cv2
import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.trajectory import Trajectory
from tools.pictures import cell_shades, draw_map, write_picture


def l_shaped():
    """Free, with a wall along the left edge and one along the bottom: tells every mirror image from the original."""
    log_odds = np.full((60, 120), -5.0, np.float32)
    log_odds[:, 0] = 5.0
    log_odds[0, :40] = 5.0
    log_odds[50:, 100:] = 0.0
    return OccupancyGrid(log_odds, 0.05, np.array([-1.0, -1.0, 0.0]))


def test_picture_has_north_up():
    gray = cv2.cvtColor(draw_map(l_shaped()), cv2.COLOR_BGR2GRAY)
    scale = gray.shape[1] // 120
    height = 60 * scale
    assert gray[height // 2, scale // 2] < 30  # wall at the left
    assert gray[height - 1, 20 * scale] < 30  # wall at the bottom, its left third
    assert gray[height - 1, 60 * scale] > 225
    assert gray[2, 110 * scale] == 205  # unknown in the upper right


def test_path_starts_green_and_goes_on_red_where_the_poses_are():
    path = Trajectory(np.arange(2, dtype=np.int64), np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 0.0]]))
    image = draw_map(l_shaped(), path).astype(int)
    scale = image.shape[1] // 120
    start = image[60 * scale - 20 * scale, 20 * scale]
    assert start[1] > start[2]
    assert start[1] > start[0]
    middle = image[60 * scale - 30 * scale, 50 * scale]
    assert middle[2] > 150 > middle[1]


def test_picture_is_written_as_png(tmp_path):
    image = draw_map(l_shaped())
    write_picture(tmp_path / "p.png", image)
    read = cv2.imread(str(tmp_path / "p.png"))
    assert read is not None
    assert np.array_equal(read, image)
    with pytest.raises(OSError, match="No such file"):
        write_picture(tmp_path / "missing" / "p.png", image)


def test_one_cell_makes_a_picture():
    assert draw_map(OccupancyGrid(np.zeros((1, 1), np.float32), 0.05, np.zeros(3))).ndim == 3


def test_every_free_cell_is_lighter_than_unknown_and_every_wall_darker():
    odds = np.array([[-7.0, -0.4, -0.01, 0.0, 0.01, 0.4, 7.0]], np.float32)
    for darkest in (0, 145):
        shades = cell_shades(odds, darkest)[0].astype(int)
        assert (np.diff(shades) <= 0).all()
        assert shades[2] > shades[3] > shades[4]
        assert (shades[0], shades[-1]) == (255, darkest)


def test_a_path_outside_of_what_is_known_is_in_the_picture():
    grid = OccupancyGrid(np.full((10, 10), -5.0, np.float32), 0.1, np.zeros(3))
    inside, outside = draw_map(grid), np.array([[-1.0, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 2.0, 0.0]])
    picture = draw_map(grid, Trajectory(np.arange(3, dtype=np.int64), outside))
    assert picture.shape[0] > 0.9 * picture.shape[1] > 0
    is_path = (picture == (60, 60, 220)).all(axis=2)
    rows, cols = np.nonzero(is_path[:-40])
    wide, high = np.ptp(cols) / picture.shape[1], np.ptp(rows) / picture.shape[0]
    assert min(wide, high) > 0.4
    assert inside.shape[0] - 40 == inside.shape[1], "as it was, without a path"
