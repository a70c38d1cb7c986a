"""OMPL's planners in two rooms: drivable, repeatable, bounded in time, and stopped when told so."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ompl_planners import EndedBy, Found, Limits, OmplPlanner, connect, find_path
from planning.vehicle import Vehicle

START, GOAL = np.array([1.0, 1.0, 0.0]), np.array([6.5, 1.5, np.pi / 2])


def never() -> bool:
    return False


def ticking(**given: Any) -> Limits:
    """Limits by a clock that goes on by 1 ms whenever it is asked, whatever the machine's load."""
    ticks = itertools.count()
    return Limits(**{"clock": lambda: next(ticks) * 1e-3, "cancelled": never, "iterations": 200, **given})


@pytest.fixture(scope="module")
def free(rooms: OccupancyGrid) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


@pytest.fixture(scope="module")
def shut(rooms: OccupancyGrid) -> Costmap:
    """The same rooms with the door closed."""
    cells = rooms.log_odds.copy()
    cells[:, 80] = 5.0
    return costmap(OccupancyGrid(cells, rooms.resolution_m, rooms.origin), Vehicle(), UnknownSpace.forbidden)


def check_drivable(found: Found | None, where: Costmap, start: np.ndarray, goal: np.ndarray) -> None:
    assert found is not None
    poses, radius_m = found.poses, where.vehicle.turning_radius_m
    np.testing.assert_allclose(poses[[0, -1], :2], [start[:2], goal[:2]], atol=1e-9)
    np.testing.assert_allclose(se2.wrap_angle(poses[[0, -1], 2] - [start[2], goal[2]]), 0.0, atol=1e-9)
    assert where.all_fit(where.world(poses))
    steps = np.diff(poses, axis=0)
    turns = se2.wrap_angle(steps[:, 2])
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    assert lengths.max() <= 0.01 + 1e-9
    assert (np.abs(turns) <= lengths / radius_m * 1.001 + 1e-9).all()
    # The car rolls where it points, in the gear that is said.
    middle = poses[:-1, 2] + turns / 2.0
    assert np.abs(steps[:, 1] * np.cos(middle) - steps[:, 0] * np.sin(middle)).max() < 1e-9
    along = steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)
    assert (along * found.gears[:-1] > 0.0).all()
    assert set(found.gears.tolist()) <= {1, -1}


def length_m(found: Found | None) -> float:
    assert found is not None
    return float(np.hypot(*np.diff(found.poses[:, :2], axis=0).T).sum())


@pytest.mark.parametrize("planner", list(OmplPlanner))
@pytest.mark.parametrize("seed", [0, 1])
def test_a_path_through_the_door_is_drivable(free, planner, seed):
    found = find_path(free, START, GOAL, planner, seed=seed, limits=ticking())
    check_drivable(found, free, START, GOAL)
    assert found.ended_by is (EndedBy.budget if planner.improves else EndedBy.found)


@pytest.mark.parametrize("planner", [OmplPlanner.rrt, OmplPlanner.rrt_connect])
def test_a_car_that_only_drives_forwards_does_so(rooms, planner):
    where = costmap(rooms, Vehicle(turning_radius_m=0.4, forward_only=True), UnknownSpace.forbidden)
    found = find_path(where, START, GOAL, planner, seed=1, limits=ticking())
    check_drivable(found, where, START, GOAL)
    assert set(found.gears.tolist()) == {1}


def test_simplified_is_shorter_than_as_found(free):
    raw, simple = (
        find_path(free, START, GOAL, OmplPlanner.rrt, seed=3, limits=ticking(), simplify=simplify)
        for simplify in (False, True)
    )
    check_drivable(raw, free, START, GOAL)
    assert length_m(simple) < length_m(raw)


@pytest.mark.parametrize(
    ("planner", "iterations"),
    [(OmplPlanner.rrt_star, 500), (OmplPlanner.informed_rrt_star, 500), (OmplPlanner.bit_star, 1500)],
)
def test_more_iterations_shorten_the_path(free, planner, iterations):
    few, many = (
        find_path(free, START, GOAL, planner, seed=1, limits=ticking(iterations=count), simplify=False)
        for count in (1, iterations)
    )
    check_drivable(many, free, START, GOAL)
    assert length_m(many) < length_m(few)
    assert many.iterations > few.iterations


@pytest.mark.parametrize("planner", list(OmplPlanner))
def test_same_seed_same_path_other_seed_other_path(free, planner):
    paths = [find_path(free, START, GOAL, planner, seed=seed, limits=ticking()) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(paths[0].poses, paths[1].poses)
    assert paths[0].iterations == paths[1].iterations
    assert paths[0].poses.shape != paths[2].poses.shape or not np.array_equal(paths[0].poses, paths[2].poses)


@pytest.mark.parametrize("planner", list(OmplPlanner))
def test_where_there_is_no_way_time_ends_the_search(shut, planner):
    ticks = itertools.count()
    limits = ticking(clock=lambda: next(ticks) * 0.01, time_limit_s=2.0)
    assert find_path(shut, START, GOAL, planner, seed=0, limits=limits) is None
    assert next(ticks) < 210


@pytest.mark.parametrize("planner", list(OmplPlanner))
def test_a_cancelled_search_stops_at_the_next_iteration(shut, planner):
    asked = itertools.count()
    limits = ticking(cancelled=lambda: next(asked) >= 50)
    assert find_path(shut, START, GOAL, planner, seed=0, limits=limits) is None
    assert next(asked) < 60


def test_what_ends_an_improving_search_is_said(free):
    def run(**given: Any) -> Found | None:
        return find_path(free, START, GOAL, OmplPlanner.rrt_star, seed=0, limits=ticking(**given))

    by_time = run(iterations=None, improve_s=0.5)
    assert by_time.ended_by is EndedBy.budget
    assert by_time.iterations == pytest.approx(500, abs=5)
    assert run(iterations=5000, time_limit_s=0.5).ended_by is EndedBy.time
    asked = itertools.count()
    assert run(iterations=5000, cancelled=lambda: next(asked) > 400).ended_by is EndedBy.cancelled


def test_an_error_in_a_callback_comes_out_of_the_search(shut):
    def interrupted() -> bool:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_path(shut, START, GOAL, OmplPlanner.rrt, seed=0, limits=Limits(time.monotonic, interrupted))


def test_a_leg_is_joined_in_its_surroundings(free):
    start, goal = np.array([1.0, 2.9, 0.3]), np.array([1.2, 3.2, np.pi])
    found = connect(free, start, goal, seed=1, limits=ticking(), around_m=1.0)
    check_drivable(found, free, start, goal)
    # The door lies outside the surroundings of these two.
    across = np.array([3.0, 1.0, 0.0]), np.array([5.0, 1.0, 0.0])
    assert connect(free, *across, seed=1, limits=ticking(most_iterations=200), around_m=0.5) is None


def test_two_processes_find_the_same_bits():
    program = """
import numpy as np
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.ompl_planners import Limits, OmplPlanner, find_path
from planning.vehicle import Vehicle
cells = np.full((100, 100), -5.0, np.float32)
cells[:60, 50] = 5.0
where = costmap(OccupancyGrid(cells, 0.05, np.zeros(3)), Vehicle(), UnknownSpace.free)
limits = Limits(clock=lambda: 0.0, cancelled=lambda: False, iterations=100)
start, goal = np.array([1.0, 1.0, 0.0]), np.array([4.0, 1.0, 2.0])
for planner in OmplPlanner:
    found = find_path(where, start, goal, planner, seed=5, limits=limits)
    print(found.poses.tobytes().hex(), found.iterations)
"""
    runs = [subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True) for _ in "ab"]
    assert len(runs[0].stdout) > 10000
    assert runs[0].stdout == runs[1].stdout
