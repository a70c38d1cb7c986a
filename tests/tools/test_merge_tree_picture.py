"""The tree of merging as a picture."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.hierarchy import first_level, next_level
from mapping import se2
from tools.merge_tree_picture import draw_tree
from tools.robot_picture import robot_color

WINDOWS = {"a": (0, 140), "b": (80, 220), "c": (160, 320)}


@pytest.fixture(scope="module")
def levels(rooms_part):
    """What is left after no, one and two levels; all maps in one frame."""
    maps = {name: rooms_part(seed, *window) for seed, (name, window) in enumerate(WINDOWS.items())}
    level, found = first_level(maps), []
    while True:
        found.append(level)
        if len(level) == 1:
            return found
        names = [each.name for each in level]
        level = next_level(level, {(names[0], names[1]): Alignment(se2.IDENTITY, True, "", 21, 0.97)})


def pixels_of(image, color) -> int:
    return int((image == np.array(color)).all(axis=2).sum())


def test_every_map_is_drawn_in_its_colour(levels):
    titles = {name: f"robot {name}" for name in WINDOWS}
    for level in levels:
        image = draw_tree(level, titles)
        assert all(pixels_of(image, robot_color(number)) > 300 for number in range(3))


def test_a_level_more_is_a_row_more(levels):
    titles = {name: name for name in WINDOWS}
    rows = [draw_tree(level, titles).shape[0] for level in levels]
    assert rows[0] < rows[1] < rows[2]


def test_many_maps_stay_a_picture_of_bounded_size(rooms_part):
    grid = rooms_part(1, 0, 60)
    level = first_level({f"map{number}": grid for number in range(60)})
    image = draw_tree(level, {each.name: each.name for each in level})
    assert image.shape[1] < 6000
    assert image.shape[0] < 300
