"""The car's planner: what ends it, which gears it takes, and the same bits for the same seed."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.both_ends import Unreachable
from planning.car_planner import CarPath, find_car_path, find_detour
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ompl_planners import EndedBy, Limits
from planning.vehicle import Vehicle

START, GOAL = np.array([1.0, 1.0, 0.0]), np.array([6.5, 1.5, np.pi / 2])


@pytest.fixture(scope="module")
def known(rooms) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


def limits(**given) -> Limits:
    return Limits(**{"clock": lambda: 0.0, "cancelled": lambda: False, "iterations": 30, **given})


def check_drivable(found: CarPath | Unreachable | None, where: Costmap) -> None:
    assert isinstance(found, CarPath)
    np.testing.assert_allclose(found.poses[[0, -1]], [START, GOAL], atol=1e-6)
    assert where.all_fit(where.world(found.poses))
    steps = np.diff(found.poses, axis=0)
    lengths_m, turns = np.hypot(steps[:, 0], steps[:, 1]), se2.wrap_angle(steps[:, 2])
    assert lengths_m.max() <= 0.01 + 1e-6
    assert (np.abs(turns) <= lengths_m / where.vehicle.turning_radius_m * 1.001 + 1e-6).all()
    middle = found.poses[:-1, 2] + turns / 2.0
    moving = lengths_m > 1e-6
    along = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
    assert (along * found.gears[:-1] > 0.0)[moving].all()
    assert lengths_m.sum() >= np.hypot(*(GOAL - START)[:2])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_path_is_drivable_and_the_same_bits_each_time(known, seed):
    one, other = (find_car_path(known, START, GOAL, seed, limits()) for _ in "ab")
    check_drivable(one, known)
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.gears, other.gears)
    assert one.iterations <= 30


def test_forward_only_never_reverses(rooms):
    where = costmap(rooms, Vehicle(turning_radius_m=0.4, forward_only=True), UnknownSpace.forbidden)
    found = find_car_path(where, START, GOAL, 0, limits())
    check_drivable(found, where)
    assert (found.gears == 1).all()


def test_more_iterations_are_never_longer_for_a_car_to_which_all_metres_are_alike(rooms):
    where = costmap(rooms, Vehicle(reverse_cost=1.0, cusp_cost_m=0.0), UnknownSpace.forbidden)
    few, many = (find_car_path(where, START, GOAL, 3, limits(iterations=n)) for n in (1, 20))
    lengths_m = [np.hypot(*np.diff(found.poses[:, :2], axis=0).T).sum() for found in (few, many)]
    assert lengths_m[1] <= lengths_m[0] + 1e-6


def test_what_ended_the_search_is_said(known):
    def ended_by(**given) -> EndedBy:
        found = find_car_path(known, START, GOAL, 0, limits(**given))
        check_drivable(found, known)
        return found.ended_by

    ticks, later, asked = itertools.count(), itertools.count(), itertools.count()
    assert ended_by(iterations=3) is EndedBy.budget
    assert ended_by(iterations=100_000) is EndedBy.converged
    assert ended_by(iterations=None, improve_s=0.05, clock=lambda: next(ticks) * 1e-3) is EndedBy.budget
    assert ended_by(time_limit_s=0.02, clock=lambda: next(later) * 1e-3) is EndedBy.time
    assert ended_by(cancelled=lambda: next(asked) > 5) is EndedBy.cancelled


def test_where_there_is_no_way_that_is_told(rooms):
    cells = rooms.log_odds.copy()
    cells[:, 80] = 5.0
    shut = costmap(OccupancyGrid(cells, rooms.resolution_m, rooms.origin), Vehicle(), UnknownSpace.forbidden)
    assert isinstance(find_car_path(shut, START, GOAL, 0, limits()), Unreachable)
    assert find_car_path(shut, START, GOAL, 0, limits(time_limit_s=0.0)) is None
    assert find_car_path(shut, START, GOAL, 0, limits(cancelled=lambda: True)) is None
    assert find_detour(shut, START, GOAL, 0, limits()) is None
