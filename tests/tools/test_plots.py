"""The picture of the demo."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.plots import MissionPicture, PlacedMaps, draw_mission, overlay


def strip(left: float) -> OccupancyGrid:
    """A wall of 1 m, then 3 m of free space, from x = left on; 1 m cells."""
    return OccupancyGrid(np.array([[5.0, -5.0, -5.0, -5.0]], np.float32), 1.0, np.array([left, 0.0, 0.0]))


def placed(title: str) -> PlacedMaps:
    drive = np.array([[1.5, 0.5, 0.0], [3.5, 0.5, 0.0]])
    return PlacedMaps(
        ("A", "B"), (strip(0.0), strip(0.0)), (drive, drive), (np.zeros(3), np.array([2.0, 0.0, 0.0])), title
    )


def picture(path: np.ndarray) -> MissionPicture:
    driven = path + np.array([0.0, 0.1, 0.0])
    return MissionPicture(placed("lidars"), strip(0.0), path, driven, placed("lidar and camera"), "t")


def test_what_both_saw_has_a_colour_of_its_own():
    image, raster = overlay(placed("two"))
    assert raster.shape == (1, 6)
    wall_a, free_a, wall_b, both, free_b, last = image[0]
    np.testing.assert_array_equal(free_b, last)
    different = {tuple(color) for color in (wall_a, free_a, wall_b, both, free_b)}
    assert len(different) == 5
    assert (wall_a < free_a).any()  # free space is the fainter one
    assert both.tolist() not in (free_a.tolist(), free_b.tolist())


@pytest.mark.parametrize("path", [np.empty((0, 3)), np.array([[1.5, 0.5, 0.0], [2.5, 0.5, 0.0], [3.5, 0.5, 0.0]])])
def test_the_picture_is_drawn_with_and_without_a_path(path, tmp_path):
    draw_mission(tmp_path / "demo.png", picture(path))
    image = cv2.imread(str(tmp_path / "demo.png"))
    assert image is not None
    assert np.ptp(image.reshape(-1, 3), axis=0).min() > 200
    thirds = np.array_split(image, 3, axis=1)
    assert all(np.ptp(third.reshape(-1, 3), axis=0).min() > 100 for third in thirds)  # each shows something
