"""Backing off against geometry: how far the tail is from what stands behind, and never into unknown space."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.path import path_along
from planning.retreat import retreat
from planning.vehicle import Vehicle

CAR = Vehicle(margin_m=0.0)
TAIL_M, SIDE_M = 0.0845, 0.096
ORIGIN = np.array([-3.0, 2.0, 0.7])
MARGINS_M = (0.04, 0.0)


def room(wall=None, unknown=None, policy=UnknownSpace.forbidden):
    """4 m x 4 m at 0.05 m, free; wall and unknown: cells."""
    cells = np.full((80, 80), -5.0, np.float32)
    if wall is not None:
        cells[wall] = 5.0
    if unknown is not None:
        cells[unknown] = 0.0
    return costmap(OccupancyGrid(cells, 0.05, ORIGIN), CAR, policy)


def at(x, y, yaw=0.0):
    return se2.compose(ORIGIN, np.array([x, y, yaw]))


def curve(backwards=False):
    """A quarter of a circle to the left that ends at (2, 2) in the room's axes, heading along x."""
    turn = np.linspace(-np.pi / 2.0, 0.0, 94)
    local = np.column_stack([2.0 + 0.6 * np.sin(turn), 2.0 + 0.6 * (1.0 - np.cos(turn)), turn])
    if backwards:  # driven in reverse, the car comes to (2, 2) tail first
        local[:, 2] += np.pi
    gears = np.full(len(local), -1 if backwards else 1, np.int8)
    return path_along(se2.compose(ORIGIN, local), gears)


def test_in_the_open_the_car_goes_back_straight_as_far_as_it_may():
    way = retreat(room(), at(2.0, 2.0), None, 0.5, MARGINS_M)
    assert way is not None
    assert (way.direction == -1).all()
    np.testing.assert_allclose(way.poses[-1], at(1.5, 2.0), atol=1e-9)
    assert way.length_m == pytest.approx(0.5)


def test_it_goes_back_as_it_came():
    way = retreat(room(), at(2.0, 2.0), curve(), 0.5, MARGINS_M)
    assert way is not None
    assert (way.direction == -1).all()
    assert way.length_m == pytest.approx(0.5, abs=0.02)
    np.testing.assert_array_equal(way.poses, curve().poses[::-1][: len(way.poses)])


def test_after_driving_backwards_back_is_ahead():
    way = retreat(room(), at(2.0, 2.0, np.pi), curve(backwards=True), 0.5, MARGINS_M)
    assert way is not None
    assert (way.direction == 1).all()


@pytest.mark.parametrize("gap_m", [0.205, 0.345])
def test_it_stops_before_what_is_behind(gap_m):
    known = room(wall=(slice(None), 20))  # its near side at x = 1.05 m
    way = retreat(known, at(1.05 + TAIL_M + gap_m, 2.0), None, 0.5, MARGINS_M)
    assert way is not None
    assert gap_m - 0.09 < way.length_m < gap_m - 0.04


def test_with_nothing_free_there_is_no_way():
    known = room(wall=(slice(None), 20))
    assert retreat(known, at(1.05 + TAIL_M + 0.02, 2.0), None, 0.5, MARGINS_M) is None


def test_unknown_space_is_not_free_where_it_is_forbidden():
    pose = at(1.5, 2.0)
    unseen = np.s_[:, 15:26]  # up to x = 1.3 m
    assert retreat(room(unknown=unseen), pose, None, 0.5, MARGINS_M).length_m < 0.15
    assert retreat(room(unknown=unseen, policy=UnknownSpace.free), pose, None, 0.5, MARGINS_M).length_m > 0.45


def test_a_car_beside_a_wall_leaves_with_less_margin():
    known = room(wall=(40, slice(None)))  # its lower side at y = 2 m
    way = retreat(known, at(2.0, 2.0 - SIDE_M - 0.02), None, 0.5, MARGINS_M)
    assert way is not None
    assert way.length_m == pytest.approx(0.5)


def test_a_car_that_touches_something_ahead_may_leave_it():
    known = room(wall=(slice(None), 60))  # its near side at x = 3 m
    way = retreat(known, at(3.0 - 0.3405 + 0.01, 2.0), None, 0.5, MARGINS_M)
    assert way is not None
    assert way.length_m == pytest.approx(0.5)
