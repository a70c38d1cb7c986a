"""The autopilot on scans of a room that are made in the test: it finds itself, plans, and stands where it must."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.vehicle import STANDSTILL
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotState

START, GOAL = np.array([1.0, 1.2, 0.0]), np.array([3.0, 1.2, 0.0])
NO_SENSOR_OFFSET = np.zeros(2)


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
    match = ScanMatch(pose, True, "")  # type: ignore[call-arg]
    return MappedScan(stamp_ns, pose, match, se2.transform_points(se2.inverse(pose), points), False, False)


def straight(known, start, goal):
    line = np.column_stack([np.arange(start[0], goal[0], 0.01)] + [np.full(len(np.arange(start[0], goal[0], 0.01)), v) for v in (start[1], 0.0)])
    return PlanResult(path_along(line), None, "")


def no_path(known, start, goal):
    return PlanResult(None, None, "there is none")


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
