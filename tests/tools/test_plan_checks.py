"""The second opinion on paths: what is wrong is found, and a path that is right is not complained of."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.path import Path, path_along
from planning.vehicle import Vehicle
from tools.plan_checks import check_path, colliding_poses, refined

CAR = Vehicle()
STRAIGHT = np.column_stack([np.linspace(0.5, 2.5, 201), np.full(201, 1.5), np.zeros(201)])


def room(*walls: tuple[int, int], yaw: float = 0.0) -> OccupancyGrid:
    """3 m x 3 m, free but for single cells (row, col) of 0.05 m."""
    cells = np.full((60, 60), -5.0, np.float32)
    for cell in walls:
        cells[cell] = 5.0
    return OccupancyGrid(cells, 0.05, np.array([2.0, -1.0, yaw]))


def faults(grid: OccupancyGrid, poses: np.ndarray, gears: np.ndarray | None = None, radius_m: float = 0.576):
    world = se2.compose(grid.origin, poses)
    path = path_along(world, gears)
    return check_path(grid, grid.occupied, path, Vehicle(turning_radius_m=radius_m), world[0], world[-1])


def arc(radius_m: float) -> np.ndarray:
    """A quarter of a circle to the left, in steps of just less than a centimetre."""
    turn = np.linspace(0.0, np.pi / 2, int(np.ceil(radius_m * np.pi / 2 / 0.0099)) + 1)
    return np.column_stack([1.0 + radius_m * np.sin(turn), 1.0 + radius_m * (1.0 - np.cos(turn)), turn])


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_good_path_has_no_faults(yaw):
    assert not faults(room(yaw=yaw), STRAIGHT).any
    assert not faults(room(yaw=yaw), STRAIGHT[::-1], np.full(201, -1, np.int8)).any
    assert not faults(room(yaw=yaw), arc(0.6)).any


@pytest.mark.parametrize(("row", "hit"), [(27, False), (28, True), (30, True), (31, True), (32, False)])
def test_a_wall_cell_within_the_width_of_the_body_is_found(row, hit):
    # y = 1.5 +- 0.096: rows 28 (1.40 to 1.45) to 31 (1.55 to 1.60) are touched.
    assert (faults(room((row, 40)), STRAIGHT).colliding > 0) == hit


def test_one_cell_hit_between_two_published_poses_is_found():
    front_m = CAR.body[:, 0].max()
    grid = room((30, 40))  # from x = 2.0
    poses = np.array([[2.0 - front_m - 0.001, 1.5, 0.0], [2.0 - front_m + 0.008, 1.5, 0.0]])
    assert colliding_poses(grid, grid.occupied, se2.compose(grid.origin, poses[:1]), CAR.body) == 0
    assert colliding_poses(grid, grid.occupied, se2.compose(grid.origin, poses), CAR.body) == 2


def test_a_corner_that_only_touches_does_not_collide():
    grid = room((30, 40))
    pose = np.array([[2.0 - CAR.body[:, 0].max(), 1.5, 0.0]])
    assert colliding_poses(grid, grid.occupied, se2.compose(grid.origin, pose), CAR.body) == 0


def test_off_the_map_counts():
    assert faults(room(), STRAIGHT - [0.45, 0.0, 0.0]).colliding > 0


def test_too_tight_a_turn_is_found():
    assert faults(room(), arc(0.5)).too_curved == len(arc(0.5)) - 1
    assert faults(room(), arc(0.5), radius_m=0.5).too_curved == 0
    assert faults(room(), arc(0.5), radius_m=0.51).too_curved > 0


def test_wrong_gears_gaps_and_sideways_steps_are_found():
    assert faults(room(), STRAIGHT, np.full(201, -1, np.int8)).wrong_gears == 200
    assert faults(room(), STRAIGHT[np.arange(201) != 100]).gaps == 1
    aside = STRAIGHT.copy()
    aside[100:, 1] += 0.002
    assert faults(room(), aside).wrong_gears == 1


def test_ends_must_be_those_asked_for():
    grid = room()
    world = se2.compose(grid.origin, STRAIGHT)
    path = path_along(world)
    assert isinstance(path, Path)
    assert check_path(grid, grid.occupied, path, CAR, world[0], world[-1] + [1e-4, 0.0, 0.0]).ends_off


def test_refining_stays_on_the_circle():
    fine = refined(arc(0.6), 0.005)
    np.testing.assert_allclose(np.hypot(fine[:, 0] - 1.0, fine[:, 1] - 1.6), 0.6, atol=1e-9)
    assert np.hypot(*np.diff(fine[:, :2], axis=0).T).max() <= 0.005
