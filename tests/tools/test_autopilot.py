"""The autopilot on scans of a room that are made in the test: it finds itself, plans, and stands where it must."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.vehicle import STANDSTILL
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from planning.ends import PlanError
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotState
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
