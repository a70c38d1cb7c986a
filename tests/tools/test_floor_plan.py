"""A drawing of a building below the maps."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fusion.resampling import Raster
from tools.errors import ToolError
from tools.floor_plan import PLAN_BGR, distance_m, draw_plan, plan_lines
from tools.map_data_set import FloorPlan


def plan_of(folder, image) -> FloorPlan:
    cv2.imwrite(str(folder / "plan.png"), image)
    return FloorPlan(folder / "plan.png", 0.1, np.array([1.0, 2.0, 0.0]))


@pytest.fixture
def line():
    """A line up at the 5th column, of 40 rows."""
    image = np.full((40, 60), 255, np.uint8)
    image[:, 5] = 0
    return image


@pytest.mark.parametrize("channels", ["gray", "16 bits", "color", "transparent"])
def test_dark_pixels_are_lines_in_the_frame_of_the_set(tmp_path, line, channels):
    image = {
        "gray": line,
        "16 bits": line.astype(np.uint16) * 257,
        "color": np.repeat(line[:, :, np.newaxis], 3, axis=2),
        "transparent": np.dstack([np.zeros((40, 60, 3), np.uint8), 255 - line]),
    }[channels]
    lines = plan_lines(plan_of(tmp_path, image))
    assert len(lines) == 40
    np.testing.assert_allclose(lines[:, 0], 1.55)
    assert (lines[:, 1].min(), lines[:, 1].max()) == pytest.approx((2.05, 5.95))


def test_a_plan_of_nothing_and_one_that_is_no_image_are_told(tmp_path):
    with pytest.raises(ToolError, match="no dark pixel"):
        plan_lines(plan_of(tmp_path, np.full((4, 4), 255, np.uint8)))
    (tmp_path / "plan.png").write_text("no image")
    with pytest.raises(ToolError, match="cannot be read"):
        plan_lines(FloorPlan(tmp_path / "plan.png", 0.1, np.zeros(3)))


@pytest.mark.parametrize("pixel_m", [0.2, 0.1, 0.03])
def test_lines_are_drawn_without_gaps_at_any_scale(tmp_path, line, pixel_m):
    raster = Raster((round(5 / pixel_m), round(4 / pixel_m)), pixel_m, np.array([0.0, 1.5, 0.0]))
    picture = np.full((*raster.shape, 3), 255, np.uint8)
    draw_plan(picture, raster, plan_lines(plan_of(tmp_path, line)), 0.1)
    drawn = (picture == np.array(PLAN_BGR)).all(axis=2)
    first, last = (round((1.5 + 5.0 - y) / pixel_m) for y in (5.8, 2.2))
    assert drawn[first:last].any(axis=1).all()


def test_distances_to_the_lines_are_in_metres(tmp_path, line):
    points = np.array([(1.55, 3.0), (2.55, 3.0), (-1.45, 4.0), (1.55, 7.95)])
    found = distance_m(points, plan_lines(plan_of(tmp_path, line)), 0.1)
    np.testing.assert_allclose(found, [0.0, 1.0, 3.0, 2.0], atol=0.11)
