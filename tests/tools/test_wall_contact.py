"""The car's rectangle against walls whose distance is known."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from tools.wall_contact import Room
from tools.world import World

FRONT_M, REAR_M, HALF_WIDTH_M = 0.128 + 0.425 / 2.0, 0.425 / 2.0 - 0.128, 0.192 / 2.0

SIDES = (((1, 0), FRONT_M), ((-1, 0), REAR_M), ((0, 1), HALF_WIDTH_M), ((0, -1), HALF_WIDTH_M))


@pytest.fixture(params=[(0.0, 0.0, 0.0), (3.0, -2.0, 0.9)])
def world(request):
    """A room of 2 m x 2 m with walls of 0.1 m, its inner corner 0.1 m from the origin, wherever that is."""
    occupied = np.ones((110, 110), np.bool_)
    occupied[5:-5, 5:-5] = False
    return World(occupied, 0.02, np.array(request.param))


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_each_side_touches_where_the_body_ends(world, turn):
    inside = np.array([1.1, 1.1, turn * np.pi / 2.0])
    room = Room(world)
    for side, reach_m in SIDES:
        for way_m, fits in ((1.0 - reach_m - 1e-4, True), (1.0 - reach_m + 1e-4, False)):
            pose = se2.compose(inside, np.array([*(way_m * np.array(side)), 0.0]))
            assert room(se2.compose(world.origin, pose)) is fits


def test_outside_of_the_world_is_no_room(world):
    assert not Room(world)(se2.compose(world.origin, np.array([-5.0, 1.0, 0.0])))
