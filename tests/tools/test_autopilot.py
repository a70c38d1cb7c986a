"""The autopilot on scans of a room that are made in the test: it finds itself, plans, and stands where it must."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from drivers.vehicle import STANDSTILL
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from planning.ends import PlanError
from planning.motion_prediction import MotionModel
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotState
from tools.drive_settings import AutopilotSettings
from tools.map_of_today import SavedGround, Sight
from tools.path_search import PathSearchHere

START, GOAL = np.array([1.0, 1.2, 0.0]), np.array([3.0, 1.2, 0.0])


@pytest.fixture
def saved():
    """5 m x 4 m at 0.05 m."""
    cells = np.full((80, 100), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, -1]] = 5.0
    cells[60:, 20:25] = 5.0
    return OccupancyGrid(cells, 0.05, np.zeros(3))


def scan(stamp_ns, pose):
    """What a car at a pose of the map sees of the four walls; odometry begins where the map does."""
    bearings = np.linspace(-np.pi, np.pi, 360, endpoint=False) + pose[2]
    cos, sin = np.cos(bearings), np.sin(bearings)
    to_x = np.where(cos > 0, 4.975 - pose[0], 0.025 - pose[0]) / np.where(np.abs(cos) < 1e-9, 1e-9, cos)
    to_y = np.where(sin > 0, 3.975 - pose[1], 0.025 - pose[1]) / np.where(np.abs(sin) < 1e-9, 1e-9, sin)
    ranges = np.minimum(np.abs(to_x), np.abs(to_y))
    points = np.column_stack([pose[0] + ranges * cos, pose[1] + ranges * sin])
    match = ScanMatch(pose, np.zeros(3), accepted=True)
    return MappedScan(stamp_ns, pose, match, se2.transform_points(se2.inverse(pose), points), False, False)


def straight(known, start, goal):
    x = np.arange(start[0], goal[0], 0.01)
    return PlanResult(path_along(np.column_stack([x, np.full(len(x), start[1]), np.zeros(len(x))])), None, "")


def no_path(known, start, goal):
    return PlanResult(None, PlanError.goal_occupied, "there is none")


def stand(pilot, seconds, scans=True):
    """Let time pass for a standing car."""
    commands = []
    for n in range(round(seconds / 0.05)):
        now_s = 1.0 + 0.05 * n
        if scans and n % 2 == 0:
            pilot.note_scan(now_s)
            pilot.add_scan(scan(round(now_s * 1e9), START))
        commands.append(pilot.tick(now_s))
    return commands


def pilot_with(saved, planner, told=START):
    return Autopilot(saved, Vehicle(), [GOAL], PathSearchHere(planner), guess=told)


def test_nothing_moves_before_the_car_knows_where_it_is(saved):
    pilot = pilot_with(saved, straight)
    assert all(safe.command == STANDSTILL for safe in stand(pilot, 1.0, scans=False))
    assert pilot.state is AutopilotState.locating
    assert "no pose yet" in pilot.tick(2.0).reason


def test_it_finds_its_place_from_what_it_was_told_and_sets_out(saved):
    pilot = pilot_with(saved, straight, told=START + np.array([0.05, -0.05, 0.04]))
    commands = stand(pilot, 2.0)
    assert pilot.place is not None
    np.testing.assert_allclose(pilot.place.T_map_base, START, atol=0.02)
    assert pilot.state is AutopilotState.driving
    assert commands[0].command.speed_mps == 0.0
    assert commands[-1].command.speed_mps > 0.0
    assert [drive.reason for drive in pilot.drives] == ["set out"]


def test_without_a_path_it_says_so_after_a_few_tries(saved):
    pilot = pilot_with(saved, no_path)
    commands = stand(pilot, 5.0)
    assert pilot.state is AutopilotState.no_way
    assert [text for _, text in pilot.notes] == ["there is none"] * 3
    assert all(safe.command.speed_mps == 0.0 for safe in commands)


def test_a_path_into_a_wall_is_not_followed(saved):
    def into_the_wall(known, start, goal):
        return straight(known, start, np.array([5.5, 1.2, 0.0]))

    pilot = Autopilot(saved, Vehicle(), [GOAL], PathSearchHere(into_the_wall), guess=np.array([4.4, 1.2, 0.0]))
    for n in range(80):
        now_s = 1.0 + 0.05 * n
        if n % 2 == 0:
            pilot.note_scan(now_s)
            pilot.add_scan(scan(round(now_s * 1e9), np.array([4.4, 1.2, 0.0])))
        pilot.tick(now_s)
    assert any("on the path" in text or "contact" in text for _, text in pilot.notes)


def test_an_emergency_stop_goes_before_everything(saved):
    pilot = pilot_with(saved, straight)
    stand(pilot, 2.0)
    pilot.safety.emergency_stop("pressed")
    safe = pilot.tick(3.0)
    assert safe.stopped
    assert safe.command.speed_mps == 0.0


class Drive:
    """A car without delay in the room, and a pilot that is ticked 20 times and told a scan 10 times a second."""

    def __init__(self, pilot, pose=START):
        self.pilot, self.pose, self.now_s, self.tick = pilot, pose, 1.0, 0
        self.states: list[AutopilotState] = []
        self.speeds: list[float] = []

    def go(self, seconds, until=lambda _: False):
        for _ in range(round(seconds / 0.05)):
            self.tick += 1
            self.now_s += 0.05
            if self.tick % 2 == 0:
                self.pilot.note_scan(self.now_s)
                self.pilot.add_scan(scan(round(self.now_s * 1e9), self.pose))
            command = self.pilot.tick(self.now_s).command
            way_m = 0.05 * command.speed_mps
            step = se2.exp(np.array([way_m, 0.0, way_m * command.curvature_1pm]))
            self.pose = se2.compose(self.pose, step)
            self.speeds.append(command.speed_mps)
            if not self.states or self.states[-1] is not self.pilot.state:
                self.states.append(self.pilot.state)
            if until(self.pilot):
                return


QUICK = AutopilotSettings(motion=MotionModel(latency_s=0.0))


def test_goals_are_driven_to_one_after_another(saved):
    goals = [np.array([2.0, 1.2, 0.0]), np.array([3.0, 1.2, 0.0])]
    drive = Drive(Autopilot(saved, Vehicle(), goals, PathSearchHere(straight), settings=QUICK, guess=START))
    drive.go(30.0, until=lambda pilot: pilot.goal_number == 1)
    np.testing.assert_allclose(drive.pose, goals[0], atol=0.03)
    assert drive.pilot.state is AutopilotState.planning
    drive.go(30.0, until=lambda pilot: pilot.state is AutopilotState.arrived)
    np.testing.assert_allclose(drive.pose, goals[1], atol=0.03)
    assert drive.pilot.status(drive.now_s) == "arrived at goal 2 of 2"
    assert [one.reason for one in drive.pilot.drives] == ["set out", "goal 1 reached"]
    s = AutopilotState
    assert drive.states == [s.locating, s.planning, s.driving, s.planning, s.driving, s.arrived]


def test_a_car_that_stands_too_near_backs_off_and_then_arrives(saved):
    def from_behind(known, start, goal):
        if start[0] > 0.8:
            return PlanResult(None, PlanError.start_occupied, "too near")
        return straight(known, start, goal)

    pilot = Autopilot(saved, Vehicle(), [GOAL], PathSearchHere(from_behind), settings=QUICK, guess=START)
    drive = Drive(pilot)
    drive.go(60.0, until=lambda pilot: pilot.state is AutopilotState.arrived)
    s = AutopilotState
    assert drive.states == [s.locating, s.planning, s.backing_off, s.planning, s.driving, s.arrived]
    assert min(drive.speeds) < 0.0
    np.testing.assert_allclose(drive.pose, GOAL, atol=0.03)
    assert [one.path.direction[0] for one in pilot.drives] == [-1, 1]


class Told:
    """Ground that tells what the test puts there; `free` may be cleared to keep it busy."""

    def __init__(self, sight):
        self.sight = sight
        self.free = threading.Event()
        self.free.set()

    def add(self, _):
        assert self.free.wait(30.0)
        return self.sight


def sights(saved):
    """A ground of the room, and a function that gives what a scan there tells."""
    ground = SavedGround(saved, Vehicle(), np.zeros(2), QUICK, START)

    def look(now_s):
        return ground.add(scan(round(now_s * 1e9), START))

    for n in range(6):
        sight = look(1.0 + 0.1 * n)
    return sight, look


def test_a_tick_does_not_wait_for_a_scan_that_is_being_matched(saved):
    sight, _ = sights(saved)
    ground = Told(sight)
    pilot = Autopilot(ground, Vehicle(), [GOAL], PathSearchHere(straight), settings=QUICK)
    pilot.note_scan(1.5)
    pilot.add_scan(scan(0, START))
    pilot.tick(1.55)
    ground.free.clear()
    mapping = threading.Thread(target=pilot.add_scan, args=(scan(0, START),))
    mapping.start()
    commands = [pilot.tick(1.6 + 0.05 * n) for n in range(20)]
    assert mapping.is_alive()
    assert "the last pose is 1.0" in commands[-1].reason  # what it rests on grows old, and the car stands
    ground.free.set()
    mapping.join()


def test_a_car_whose_place_is_lost_stands_and_plans_again_when_it_is_found(saved):
    sight, look = sights(saved)
    ground = Told(sight)
    pilot = Autopilot(ground, Vehicle(), [GOAL], PathSearchHere(straight), settings=QUICK)

    times = iter(np.arange(2.0, 10.0, 0.05).tolist())

    def tick(seconds):
        for _ in range(round(seconds / 0.05)):
            now_s = next(times)
            pilot.note_scan(now_s)
            ground.sight = look(now_s) if ground.sight.place is not None else ground.sight
            pilot.add_scan(scan(0, START))
            safe = pilot.tick(now_s)
        return safe

    assert tick(1.5).command.speed_mps > 0.0
    ground.sight = Sight(None, "lost after 3.0 m without a scan that fits")
    assert tick(0.1).command.speed_mps == 0.0
    assert pilot.state is AutopilotState.lost
    assert "lost after 3.0 m" in pilot.status(3.7)
    assert pilot.place is None
    ground.sight = look(3.7)
    assert tick(1.5).command.speed_mps > 0.0
    assert [drive.reason for drive in pilot.drives] == ["set out", "found again"]


def test_a_drive_loop_that_stands_still_is_told(saved):
    pilot = pilot_with(saved, straight)
    stand(pilot, 1.0)
    assert "stuck" in pilot.status(5.0)


def test_without_a_goal_there_is_no_pilot(saved):
    with pytest.raises(ValueError, match="no goal"):
        Autopilot(saved, Vehicle(), [], PathSearchHere(straight))
