"""Local maps where they truly are."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from mapping.map_io import read_map
from tools.floor_plan import PLAN_BGR
from tools.local_maps_picture import draw_local_maps, placed_on_plan
from tools.placed_maps_picture import PlacedMap
from tools.robot_picture import robot_color


def count(image, color) -> int:
    return int((image == np.array(color)).all(axis=2).sum())


def test_every_map_has_its_colour_and_the_plan_is_black(rooms_set, tmp_path):
    draw_local_maps(tmp_path / "a.png", rooms_set)
    image = cv2.imread(str(tmp_path / "a.png"))
    assert all(count(image, robot_color(number)) > 200 for number in range(3))
    assert count(image, PLAN_BGR) > 1000


def test_without_a_plan_and_without_its_scale_the_maps_alone_are_drawn(rooms_set):
    maps = [PlacedMap(read_map(rooms_set.maps[0].path), np.zeros(3), robot_color(0))]
    for plan in (None, replace(rooms_set.floor_plan, resolution_m=None)):
        image = placed_on_plan(maps, [("west", robot_color(0))], plan)
        assert count(image, robot_color(0)) > 200
        assert count(image, PLAN_BGR) == 0
