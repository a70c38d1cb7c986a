"""The search of all poses: ways that the car may drive, from either end, and an end where there is none."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.lattice import LatticeSearch, LatticeWidth, Outcome
from planning.pieces import Pieces
from planning.vehicle import Vehicle

ENDS = np.array([[1.0, 1.0, 0.0], [6.5, 1.5, np.pi / 2]])
APART = np.array([[0.8, 0.4, 0.0], [2.2, 0.5, 0.0]])  # on both sides of the walls of the passage
SIDES = pytest.mark.parametrize("backwards", [False, True])


def searched(where: Costmap, ends: np.ndarray, *, backwards: bool, share: float = 0.5) -> LatticeSearch:
    search = LatticeSearch(where, ends, LatticeWidth.of(where, share), backwards=backwards)
    outcomes = (search.advance(500) for _ in itertools.repeat(None))
    last = next(outcome for outcome in outcomes if outcome is not Outcome.open)
    assert last is Outcome.found
    return search


def check_way(way: Pieces, where: Costmap, ends: np.ndarray) -> None:
    poses, gears = way.sampled(where.vehicle.turning_radius_m)
    np.testing.assert_allclose(poses[[0, -1], :2], ends[:, :2], atol=1e-9)
    assert np.abs(np.angle(np.exp(1j * (poses[[0, -1], 2] - ends[:, 2])))).max() < 1e-9
    assert where.all_fit(where.world(poses))
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.01 + 1e-9
    along = np.diff(poses[:, :2], axis=0)
    ahead = along[:, 0] * np.cos(poses[:-1, 2]) + along[:, 1] * np.sin(poses[:-1, 2])
    assert (ahead * gears[:-1] >= -1e-9).all()


@SIDES
def test_a_way_can_be_driven_from_start_to_goal(rooms, backwards):
    where = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    check_way(searched(where, ENDS, backwards=backwards).way(), where, ENDS)


@SIDES
def test_forward_only_cars_never_reverse(rooms, backwards):
    where = costmap(rooms, Vehicle(turning_radius_m=0.4, forward_only=True), UnknownSpace.forbidden)
    way = searched(where, ENDS, backwards=backwards).way()
    check_way(way, where, ENDS)
    assert (way.lengths >= 0.0).all()


@SIDES
def test_a_car_gets_out_of_where_it_must_go_to_and_fro(rooms, backwards):
    cells = rooms.log_odds.copy()
    cells[16:18, 14:33] = cells[26:28, 14:33] = 5.0  # walls on both sides of the car, 0.4 m apart
    cells[16:28, 14] = cells[16:28, 33] = 5.0  # and before and behind it, where it ...
    cells[26:28, 24:33] = -5.0  # ... has a gap beside it
    where = costmap(OccupancyGrid(cells, rooms.resolution_m, rooms.origin), Vehicle(), UnknownSpace.forbidden)
    ends = np.array([[1.05, 1.1, 0.0], [6.5, 1.5, np.pi / 2]])
    way = searched(where, ends, backwards=backwards).way()
    check_way(way, where, ends)
    assert (way.lengths < 0.0).any()


@SIDES
def test_all_poses_fit_and_no_two_lie_in_one_cell(rooms, backwards):
    where = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    width = LatticeWidth.of(where, 0.5)
    search = LatticeSearch(where, ENDS, width, backwards=backwards)
    search.advance(300)
    assert where.all_fit(where.world(search.poses))
    cells = np.floor(search.poses[1:, :2] / width.cell_m).astype(int)
    headings = np.floor(search.poses[1:, 2] % (2 * np.pi) / (2 * np.pi) * width.headings).astype(int)
    assert len({*map(tuple, np.column_stack([cells, headings]).tolist())}) == search.count - 1


def test_it_remembers_what_it_saw_when_it_needs_more_room(rooms):
    where = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    width, away = LatticeWidth.of(where, 0.2), np.array([ENDS[0], ENDS[0] + [0.0, 0.0, 1e-3]])
    small, large = (LatticeSearch(where, away, width, backwards=False) for _ in "ab")
    for _ in range(80):
        small.advance(50)
    large.advance(4000)
    np.testing.assert_array_equal(small.poses, large.poses)


@SIDES
def test_where_no_way_is_left_it_is_exhausted(passage, backwards):
    where = costmap(passage, Vehicle(), UnknownSpace.forbidden)
    search = LatticeSearch(where, APART, LatticeWidth.of(where, 0.5), backwards=backwards)
    assert next(outcome for outcome in iter(lambda: search.advance(500), None) if outcome) is Outcome.exhausted
