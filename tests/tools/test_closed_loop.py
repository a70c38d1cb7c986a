"""Whole drives in a room: bytes, decoder, SLAM, autopilot, car. The longest tests of driving, some seconds each."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.plan import PlanSettings, plan
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotState
from tools.closed_loop import ClosedLoop
from tools.config import Config
from tools.path_search import PathSearchHere
from tools.simulated_car import SimulatedCar
from tools.world import World

T_WORLD_MAP = np.array([0.5, -0.3, 0.4])  # the map's frame is not the world's
START, GOAL = np.array([1.0, 1.0, 0.1]), np.array([3.6, 1.8, 0.6])  # in the world
BOX = np.array([[2.5, 1.25], [2.8, 1.25], [2.8, 1.55], [2.5, 1.55]])


def find_path(known, start, goal):
    return plan(known, start, goal, PlanSettings(iterations=50), seed=0, clock=lambda: 0.0)


@pytest.fixture
def room():
    """5 m x 4 m with a niche, so that it is not symmetric."""
    occupied = np.zeros((200, 250), np.bool_)
    occupied[[0, 1, -2, -1], :] = True
    occupied[:, [0, 1, -2, -1]] = True
    occupied[150:, 30:70] = True
    return World(occupied, 0.02, np.zeros(3))


def saved_map(room):
    """The room as a map of 0.05 m in a frame of its own."""
    grid = np.full((80, 100), -5.0, np.float32)
    rows, cols = np.nonzero(room.occupied)
    grid[(rows * 0.02 / 0.05).astype(int), (cols * 0.02 / 0.05).astype(int)] = 5.0
    return OccupancyGrid(grid, 0.05, se2.inverse(T_WORLD_MAP))


def loop(room, goal=GOAL, disturb=lambda *_: None):
    """A closed loop; disturb(loop, pilot, world, now_s)."""
    config = Config()
    car = SimulatedCar(room, START, config.mount(), seed=3)
    T_map_world = se2.inverse(T_WORLD_MAP)
    told = se2.compose(se2.compose(T_map_world, START), np.array([0.04, -0.03, 0.04]))
    in_map = se2.compose(T_map_world, goal)
    sensor = config.mount().pose[:2]
    pilot = Autopilot(saved_map(room), Vehicle(), [in_map], PathSearchHere(find_path), sensor, guess=told)
    closed = ClosedLoop(car, pilot, config, disturb=lambda now_s: disturb(closed, pilot, car.world, now_s))
    return closed, pilot, car.world


def test_the_car_arrives_on_its_own_pose(room):
    closed, pilot, world = loop(room)
    closed.run(40.0)
    assert pilot.state is AutopilotState.arrived
    off = se2.between(GOAL, world.truth[1][-1])
    assert np.hypot(off[0], off[1]) < 0.1
    assert abs(off[2]) < np.radians(15.0)
    assert world.truth[2].max() <= 0.5 + 1e-9
    assert len(pilot.drives) == 1


def test_a_box_on_the_path_is_never_touched(room):
    def put(_, pilot, world, __):
        if pilot.step is not None and pilot.step.progress_m > 0.2 and not world.world.occupied[70, 130]:
            world.put_box(BOX)

    closed, pilot, world = loop(room, disturb=put)
    closed.run(80.0)
    assert world.world.occupied[70, 130]
    assert pilot.state in (AutopilotState.arrived, AutopilotState.no_way)
    assert pilot.notes[0][1].startswith("something on the path")
    assert len(pilot.drives) > 1
    outline = Vehicle().body
    for pose in world.truth[1][::5]:
        x, y = se2.transform_points(pose, outline).T
        assert not ((x > 2.5) & (x < 2.8) & (y > 1.25) & (y < 1.55)).any()


def test_without_scans_the_car_stops_and_says_why(room):
    lost: list[float] = []

    def unplug(closed, pilot, _, now_s):
        if pilot.step is not None and pilot.step.progress_m > 0.5 and not lost:
            lost.append(now_s)
            closed.unplug_lidar()

    closed, _, world = loop(room, disturb=unplug)
    closed.run(60.0, until=lambda now_s: bool(lost) and now_s > lost[0] + 1.5)
    assert world.truth[2][-1] == 0.0
    assert "s old" in closed.log.ticks[-1].safe.reason
    zero_s = next(tick.now_s for tick in closed.log.ticks if tick.now_s > lost[0] and tick.safe.stopped)
    assert zero_s - closed.log.last_scan_s <= 0.6


def test_a_goal_in_a_wall_is_no_way(room):
    closed, pilot, world = loop(room, goal=np.array([0.02, 2.0, 0.0]))
    closed.run(20.0)
    assert pilot.state is AutopilotState.no_way
    assert "goal" in pilot.notes[0][1]
    np.testing.assert_allclose(world.truth[1][-1], START)
