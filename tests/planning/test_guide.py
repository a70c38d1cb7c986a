"""The guide's coarse cells against the fine ones that they stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planning.costmap import Costmap, UnknownSpace, costmap
from planning.guide import make_guide, refresh_guide
from planning.vehicle import Vehicle


@pytest.fixture
def known(rooms) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


def test_a_coarse_cell_stands_for_its_roomiest_fine_one(known):
    guide, cell_m = known.guide, known.grid.resolution_m
    assert guide.factor > 1
    for (row, col), room_m in np.ndenumerate(guide.room_m):
        top, left = row * guide.factor, col * guide.factor
        fine = known.to_blocked_m[top : top + guide.factor, left : left + guide.factor]
        assert room_m == fine.max()
        x, y = guide.anchors[row, col]
        assert known.to_blocked_m[int(y / cell_m), int(x / cell_m)] == room_m
        assert guide.cell(x, y, cell_m) == (row, col)
        assert guide.cost[row, col] >= known.route_cost[int(y / cell_m), int(x / cell_m)]


def test_where_the_axle_cannot_be_the_guide_is_closed(known):
    region = known.region > 0
    for row, col in np.argwhere(np.isfinite(known.guide.cost)).tolist():
        factor = known.guide.factor
        assert region[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor].any()


def test_a_refreshed_window_is_as_a_new_guide(known):
    cell_m, price = known.grid.resolution_m, known.route_cost.copy()
    price[31:50, 20:33] *= 2.0
    old = replace(known.guide, cost=known.guide.cost.copy())
    refresh_guide(old, price, known.to_blocked_m, cell_m, known.vehicle, (31, 20, 50, 33))
    fresh = make_guide(price, known.to_blocked_m, cell_m, known.vehicle)
    np.testing.assert_array_equal(old.cost, fresh.cost)
    np.testing.assert_array_equal(old.room_m, fresh.room_m)
