"""Plans in two rooms: solved, refused with a name, and never through a wall."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.ends import GoalTolerance, PlanError
from planning.errors import PlanningError
from planning.ompl_planners import EndedBy
from planning.plan import Planner, PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from tools.plan_checks import colliding_poses

QCAR = Vehicle()


def at(grid: OccupancyGrid, x: float, y: float, yaw: float) -> np.ndarray:
    """A pose given in the grid's own axes, in the map frame."""
    return se2.compose(grid.origin, np.array([x, y, yaw]))


def run(
    grid: OccupancyGrid,
    start: np.ndarray,
    goal: np.ndarray,
    seed: int = 0,
    *,
    unknown: UnknownSpace = UnknownSpace.forbidden,
    **settings: object,
) -> PlanResult:
    # A clock that stands still: the result is no matter of the machine's load.
    chosen = PlanSettings(**{"iterations": 30, **settings})  # type: ignore[arg-type]
    return plan(costmap(grid, QCAR, unknown), start, goal, chosen, seed=seed, clock=lambda: 0.0)


@pytest.mark.parametrize("planner", list(Planner))
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_path_through_the_door_is_drivable(rooms, planner, seed):
    start, goal = at(rooms, 1.0, 1.0, 0.0), at(rooms, 6.5, 1.5, np.pi / 2)
    result = run(rooms, start, goal, seed, planner=planner)
    path = result.path
    assert path is not None, result.reason
    np.testing.assert_allclose(path.poses[[0, -1], :2], [start[:2], goal[:2]], atol=1e-6)
    np.testing.assert_allclose(se2.wrap_angle(path.poses[[0, -1], 2] - [start[2], goal[2]]), 0.0, atol=1e-6)
    assert colliding_poses(rooms, rooms.occupied, path.poses, QCAR.body) == 0
    steps = np.diff(path.poses, axis=0)
    lengths, turns = np.hypot(steps[:, 0], steps[:, 1]), np.abs(se2.wrap_angle(steps[:, 2]))
    assert lengths.max() <= 0.0101
    # A step across a change of gear goes there and back: its chord is shorter than what the car drives.
    change = np.abs(np.diff(path.direction[:-1])) > 0
    rolling = ~(np.append(change, False) | np.insert(change, 0, False))
    assert (turns[rolling] <= lengths[rolling] / QCAR.turning_radius_m + 1e-4).all()
    assert turns.max() <= 0.0101 / QCAR.turning_radius_m
    # The car rolls where it points: no sliding sideways.
    middle = path.poses[:-1, 2] + se2.wrap_angle(steps[:, 2]) / 2
    sideways = -steps[:, 0] * np.sin(middle) + steps[:, 1] * np.cos(middle)
    assert np.abs(sideways[rolling]).max() < 1e-3
    assert result.min_clearance_m is not None
    assert result.min_clearance_m > 0.0


def test_speed_is_zero_at_the_end_and_crawls_at_gear_changes(rooms):
    path = run(rooms, at(rooms, 1.0, 1.0, 0.0), at(rooms, 1.0, 1.4, np.pi)).path
    assert path is not None
    changes = [i for i, (a, b) in enumerate(itertools.pairwise(path.direction), 1) if a != b]
    assert changes
    assert path.speed_mps[-1] == 0.0
    assert path.speed_mps[changes].max() <= 0.05
    assert path.speed_mps.max() <= 0.5
    acceleration = np.diff(path.speed_mps**2) / (2 * np.hypot(*np.diff(path.poses[:, :2], axis=0).T))
    assert np.abs(acceleration).max() < 0.31


def test_same_seed_same_path_other_seed_other_path(rooms):
    start, goal = at(rooms, 1.0, 1.0, 0.0), at(rooms, 6.5, 1.5, np.pi / 2)
    paths = [run(rooms, start, goal, seed).path for seed in (4, 4, 5)]
    assert paths[0] is not None
    assert paths[1] is not None
    assert paths[2] is not None
    np.testing.assert_array_equal(paths[0].poses, paths[1].poses)
    assert paths[0].poses.shape != paths[2].poses.shape or not np.array_equal(paths[0].poses, paths[2].poses)


@pytest.mark.parametrize(
    ("start", "goal", "error", "words"),
    [
        ((-1.0, 1.0, 0.0), (2.0, 2.0, 0.0), PlanError.start_outside_map, "outside the map"),
        ((1.0, 1.0, 0.0), (2.0, 60.0, 0.0), PlanError.goal_outside_map, "outside the map"),
        ((4.02, 1.0, 0.0), (2.0, 2.0, 0.0), PlanError.start_occupied, "on an occupied cell"),
        ((1.0, 1.0, 0.0), (3.8, 1.0, 0.0), PlanError.goal_occupied, "occupied cell"),
        ((1.0, 1.0, 0.0), (7.2, 5.2, 0.0), PlanError.goal_in_unknown_space, "unknown"),
    ],
)
def test_ends_that_cannot_be_are_named_with_a_way_out(rooms, start, goal, error, words):
    result = run(rooms, at(rooms, *start), at(rooms, *goal))
    assert result.error is error
    assert result.path is None
    assert words in result.reason
    assert result.advice is not None
    wanted = at(rooms, *(start if "START" in error.value else goal))
    other = at(rooms, *(goal if "START" in error.value else start))
    assert np.hypot(*(result.advice - wanted)[:2]) < (60.0 if "OUTSIDE" in error.value else 1.5)
    assert run(rooms, other, result.advice).path is not None


@pytest.mark.parametrize("gap_m", [0.095, 0.1, 0.105])
def test_a_car_backed_against_a_wall_drives_off(gap_m):
    cells = np.full((200, 300), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    grid = OccupancyGrid(cells, 0.02, np.zeros(3))
    assert run(grid, np.array([0.02 + gap_m, 2.0, 0.0]), np.array([4.0, 2.0, 0.0])).path is not None


def test_a_goal_at_the_end_of_the_world_is_outside_the_map(rooms):
    result = run(rooms, at(rooms, 1.0, 1.0, 0.0), np.array([1e300, 0.0, 0.0]))
    assert result.error is PlanError.goal_outside_map


def test_unseen_space_may_be_allowed(rooms):
    goal = at(rooms, 7.2, 5.2, 0.0)
    assert run(rooms, at(rooms, 1.0, 1.0, 0.0), goal, unknown=UnknownSpace.free).path is not None


def test_a_speck_smaller_than_the_car_is_no_obstacle(rooms):
    assert run(rooms, at(rooms, 1.0, 3.0, 0.0), at(rooms, 1.5, 1.0, 0.0)).path is not None


def test_a_closed_door_is_no_valid_path_at_once(rooms):
    cells = rooms.log_odds.copy()
    cells[:, 80] = 5.0
    shut = OccupancyGrid(cells, rooms.resolution_m, rooms.origin)
    start = at(rooms, 1.0, 1.0, 0.0)
    result = run(shut, start, at(rooms, 6.5, 1.5, 0.0))
    assert result.error is PlanError.no_valid_path
    assert result.advice is not None
    assert se2.transform_points(se2.inverse(rooms.origin), result.advice[np.newaxis, :2])[0, 0] < 4.0
    assert run(shut, start, result.advice).path is not None


def test_too_little_time_is_a_timeout(rooms):
    result = run(rooms, at(rooms, 1.0, 1.0, 0.0), at(rooms, 6.5, 1.5, 0.0), time_limit_s=0.0)
    assert result.error is PlanError.timeout


def test_maps_without_free_space_refuse_every_end(rooms):
    for value in (0.0, 5.0):
        grid = OccupancyGrid(np.full((1, 1), value, np.float32), 0.05, np.zeros(3))
        result = run(grid, np.array([0.02, 0.02, 0.0]), np.array([0.02, 0.02, 0.0]))
        assert result.error is PlanError.start_occupied
        assert result.advice is None


def test_poses_must_be_finite(rooms):
    with pytest.raises(PlanningError, match="not a finite pose"):
        run(rooms, np.array([np.nan, 0.0, 0.0]), at(rooms, 1.0, 1.0, 0.0))


def test_a_cancelled_search_says_so(rooms):
    start, goal = at(rooms, 1.0, 1.0, 0.0), at(rooms, 6.5, 1.5, 0.0)
    where = costmap(rooms, QCAR, UnknownSpace.forbidden)
    for planner in (Planner.car, Planner.rrt):
        settings = PlanSettings(planner)
        result = plan(where, start, goal, settings, seed=0, clock=lambda: 0.0, cancelled=lambda: True)
        assert result.error is PlanError.cancelled
        assert result.ended_by is EndedBy.cancelled


def test_without_a_seed_the_clock_ends_it(rooms):
    ticks = itertools.count()
    where = costmap(rooms, QCAR, UnknownSpace.forbidden)
    ends = at(rooms, 1.0, 1.0, 0.0), at(rooms, 6.5, 1.5, 0.0)
    result = plan(where, *ends, PlanSettings(budget_s=0.1), seed=None, clock=lambda: next(ticks) * 1e-3)
    assert result.ended_by is EndedBy.budget
    assert result.first_path_s is not None
    assert 0.0 < result.first_path_s < result.seconds < 0.2


def test_a_goal_may_be_moved_within_its_tolerance(rooms):
    start, goal = at(rooms, 1.0, 1.0, 0.0), at(rooms, 3.75, 1.0, np.pi)
    assert run(rooms, start, goal).path is not None
    tight = at(rooms, 3.95, 1.0, np.pi)
    assert run(rooms, start, tight).error is PlanError.goal_occupied
    moved = run(rooms, start, tight, tolerance=GoalTolerance(0.4, 0.0))
    assert moved.path is not None
    assert 0.0 < np.hypot(*(moved.path.poses[-1] - tight)[:2]) <= 0.4 + 1e-6
    assert "moved" in moved.reason
