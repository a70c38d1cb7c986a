"""A changed map: what is still free stays as it is, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ends import PlanError
from planning.errors import PlanningError
from planning.path import Path
from planning.plan import Kept, PlanResult, PlanSettings, plan
from planning.replan import replan
from planning.vehicle import Vehicle
from tools.plan_checks import colliding_poses

SETTINGS = PlanSettings(iterations=20)


def known(grid: OccupancyGrid) -> Costmap:
    return costmap(grid, Vehicle(), UnknownSpace.forbidden)


@pytest.fixture(scope="module")
def driven(rooms) -> Path:
    start, goal = se2.compose(rooms.origin, np.array([[1.0, 1.0, 0.0], [7.0, 2.5, 0.0]]))
    path = plan(known(rooms), start, goal, SETTINGS, seed=1, clock=lambda: 0.0).path
    assert path is not None
    return path


def with_box(rooms: OccupancyGrid, pose: np.ndarray, half: int = 3) -> OccupancyGrid:
    """The rooms with a box around a pose."""
    cells = rooms.log_odds.copy()
    col, row = np.floor(rooms.cell_coordinates(pose[np.newaxis, :2])[0]).astype(int)
    cells[row - half : row + half + 1, col - half : col + half + 1] = 5.0
    return OccupancyGrid(cells, rooms.resolution_m, rooms.origin)


def run(grid: OccupancyGrid, path: Path, progress: int, car: np.ndarray | None = None) -> PlanResult:
    return replan(known(grid), path, progress, SETTINGS, car=car, seed=1, clock=lambda: 0.0)


def test_a_path_that_is_still_free_is_kept_as_it_is(rooms, driven):
    elsewhere = with_box(rooms, se2.compose(rooms.origin, np.array([1.0, 5.0, 0.0])))
    for progress in (0, 100, len(driven.poses) - 1):
        result = run(elsewhere, driven, progress)
        assert result.kept is Kept.all
        assert result.path is not None
        np.testing.assert_array_equal(result.path.poses, driven.poses[progress:])
        np.testing.assert_array_equal(result.path.direction, driven.direction[progress:])
        np.testing.assert_array_equal(result.path.speed_mps, driven.speed_mps[progress:])


def test_what_is_blocked_is_driven_round_and_the_rest_keeps_its_bits(rooms, driven):
    along_m = np.cumsum(np.hypot(*np.diff(driven.poses[:, :2], axis=0).T))
    at = int(np.searchsorted(along_m, along_m[-1] - 1.6))
    changed = with_box(rooms, driven.poses[at], half=1)
    assert known(changed).first_misfit(driven.poses) is not None
    result = run(changed, driven, 10)
    assert result.kept is Kept.ends
    assert result.path is not None
    poses = result.path.poses
    assert colliding_poses(changed, changed.occupied, poses, Vehicle().body) == 0
    assert known(changed).all_fit(poses)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.01 + 1e-6
    rest = driven.poses[10:]
    shared = min(len(poses), len(rest))
    prefix = int(np.argmin((poses[:shared] == rest[:shared]).all(axis=1)))
    suffix = int(np.argmin((poses[::-1][:shared] == rest[::-1][:shared]).all(axis=1)))
    assert prefix > 50
    assert suffix > 20
    np.testing.assert_array_equal(result.path.direction[-suffix:], driven.direction[-suffix:])
    steps = np.diff(poses, axis=0)
    middle = poses[:-1, 2] + se2.wrap_angle(steps[:, 2]) / 2.0
    along = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
    assert (along * result.path.direction[:-1] > -1e-9).all()


def test_a_car_that_is_boxed_in_on_its_path_plans_anew_from_where_it_is(rooms, driven):
    changed = with_box(rooms, driven.poses[0], half=1)
    car = se2.compose(rooms.origin, np.array([2.0, 2.5, 0.5]))
    result = run(changed, driven, 0, car)
    assert result.kept is Kept.nothing
    assert result.path is not None
    assert np.abs(result.path.poses[0] - car).max() < 1e-9
    assert run(changed, driven, 0).error is PlanError.start_occupied


def test_a_goal_or_a_door_that_is_blocked_is_the_error_of_a_plan(rooms, driven):
    assert run(with_box(rooms, driven.poses[-1]), driven, 0).error is PlanError.goal_occupied
    cells = rooms.log_odds.copy()
    cells[:, 80] = 5.0
    shut = OccupancyGrid(cells, rooms.resolution_m, rooms.origin)
    assert run(shut, driven, 0).error is PlanError.no_valid_path


@pytest.mark.parametrize("progress", [-1, 10**6])
def test_progress_is_a_pose_of_the_path(rooms, driven, progress):
    with pytest.raises(PlanningError, match="progress"):
        run(rooms, driven, progress)
