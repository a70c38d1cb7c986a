"""Robots in a map's picture."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.pictures import draw_map
from tools.robot_picture import draw_robots, robot_color


@pytest.fixture
def grid():
    return OccupancyGrid(np.full((300, 400), -3.0, np.float32), 0.05, np.zeros(3))


def count(image, color) -> int:
    return int((image == np.array(color)).all(axis=2).sum())


def test_each_robot_has_its_colour_and_is_drawn_where_it_drove(grid):
    drives = [
        ("a", np.array([(2.0, 3.0, 0.0), (12.0, 3.0, 0.0)])),
        ("b", np.array([(2.0, 10.0, 0.0), (9.0, 10.0, 0.0)])),
    ]
    image = draw_robots(grid, drives)
    scale = 1200 / 400
    for number, (_, poses) in enumerate(drives):
        y = round(300 * scale - poses[0, 1] / 0.05 * scale)
        row = image[y - 2 : y + 3, round(5.0 / 0.05 * scale)]
        assert (row == np.array(robot_color(number))).all(axis=1).any()


def test_without_robots_it_is_the_map(grid):
    np.testing.assert_array_equal(draw_robots(grid, []), draw_map(grid))


def test_the_arrow_points_where_the_robot_looks(grid):
    east = draw_robots(grid, [("a", np.array([(10.0, 7.0, 0.0)]))])
    north = draw_robots(grid, [("a", np.array([(10.0, 7.0, np.pi / 2)]))])
    mask = (east[:900] == np.array(robot_color(0))).all(axis=2), (north[:900] == np.array(robot_color(0))).all(axis=2)
    wide = [np.ptp(np.nonzero(each)[1]) - np.ptp(np.nonzero(each)[0]) for each in mask]
    assert wide[0] > 0 > wide[1]


def test_colours_differ_for_many_robots():
    colors = [np.array(robot_color(number), float) for number in range(24)]
    assert min(np.abs(a - b).sum() for a, b in itertools.combinations(colors, 2)) > 10
    assert min(np.abs(a - b).sum() for a, b in itertools.combinations(colors[:7], 2)) > 60


@pytest.mark.parametrize("many", [1, 12, 300])
def test_the_legend_fits_any_number_of_names(grid, many):
    image = draw_robots(grid, [(f"a robot with quite a long name {n}", np.zeros((1, 3))) for n in range(many)])
    assert image.shape[1] == 1200
    assert image.shape[0] < 900 + 40 + 10 * 30 + 8


def test_a_drive_far_off_the_map_is_still_a_picture(grid):
    image = draw_robots(grid, [("lost", np.array([(1.0, 1.0, 0.0), (1.0, 1e9, 0.0)]))])
    assert max(image.shape) < 10_000
