from __future__ import annotations

import numpy as np
import pytest

from tools.solid_world import ROOM_HEIGHT_M, SolidWorld, solid
from tools.world import BUILT_IN, World, load_world


def plan(*boxes, cell_m=0.02):
    """A room of 6 m by 5 m, and boxes x0, y0, x1, y1 (m) in it."""
    occupied = np.zeros((250, 300), bool)
    occupied[[0, -1]], occupied[:, [0, -1]] = True, True
    for box in boxes:
        x0, y0, x1, y1 = (round(edge / cell_m) for edge in box)
        occupied[y0:y1, x0:x1] = True
    return World(occupied, cell_m, np.zeros(3))


def height_at(world, x, y):
    return float(world.heights_m[int(y / world.resolution_m), int(x / world.resolution_m)])


def test_boxes_are_low_and_walls_and_pillars_high():
    pillar = plan((1.0, 1.0, 1.6, 1.8), (3.0, 1.0, 3.1, 3.0), (4.0, 1.0, 4.2, 3.0), (4.0, 2.8, 5.0, 3.0))
    rows, cols = np.ogrid[:250, :300]
    pillar.occupied[(rows - 200) ** 2 + (cols - 100) ** 2 < 15**2] = True
    world = solid(pillar)
    assert 0.4 <= height_at(world, 1.3, 1.4) <= 1.2  # a cupboard
    assert height_at(world, 3.05, 2.0) == ROOM_HEIGHT_M  # a thin wall
    assert height_at(world, 4.1, 2.0) == ROOM_HEIGHT_M  # an angle of walls
    assert height_at(world, 2.0, 4.0) == ROOM_HEIGHT_M  # a round pillar
    assert height_at(world, 0.01, 2.0) == ROOM_HEIGHT_M  # the room's own wall
    assert height_at(world, 2.0, 2.0) == 0.0


@pytest.mark.parametrize("name", BUILT_IN)
def test_plan_stays_and_heights_follow_the_seed(name):
    walls = load_world(name)
    worlds = [solid(walls, seed) for seed in (1, 1, 2)]
    assert np.array_equal(worlds[0].heights_m > 0, walls.occupied)
    assert np.array_equal(worlds[0].heights_m, worlds[1].heights_m)
    assert not np.array_equal(worlds[0].heights_m, worlds[2].heights_m)
    low = worlds[0].heights_m[(worlds[0].heights_m > 0) & (worlds[0].heights_m < ROOM_HEIGHT_M)]
    assert len(np.unique(low)) >= 8  # that many pieces of furniture stand free
    assert low.min() >= 0.4
    assert low.max() <= 1.2


def test_laser_sees_what_crosses_its_plane():
    heights = np.array([[0.0, 0.15, 0.7, 0.75, ROOM_HEIGHT_M]], np.float32)
    bottoms = np.array([[0.0, 0.0, 0.0, 0.7, 0.0]], np.float32)
    world = SolidWorld(heights, bottoms, 0.5, np.array([1.0, 2.0, 0.3]))
    for z_m, seen in ((0.1, [0, 1, 1, 0, 1]), (0.19, [0, 0, 1, 0, 1]), (0.72, [0, 0, 0, 1, 1])):
        plan_there = world.cut(z_m)
        assert plan_there.occupied.tolist() == [[bool(each) for each in seen]]
        assert (plan_there.resolution_m, plan_there.origin.tolist()) == (0.5, [1.0, 2.0, 0.3])
