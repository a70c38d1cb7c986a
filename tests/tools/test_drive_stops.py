"""Stops on the way through the real link, in the office whose map is made from the world itself: some seconds each."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.drive_bench import WORLD, Bench, Mapped
from tools.drive_stops import STOP_S, StopCause, stop_on_the_way, told_stop
from tools.world import load_world

RESOLUTION_M = 0.05


@pytest.fixture(scope="module")
def bench():
    """The office, mapped without error."""
    world = load_world(WORLD)
    rows, cols = np.nonzero(world.occupied)
    scale = world.resolution_m / RESOLUTION_M
    shape = tuple(int(np.ceil(size * scale)) for size in world.occupied.shape)
    cells = np.full(shape, -5.0, np.float32)
    cells[(rows * scale).astype(int), (cols * scale).astype(int)] = 5.0
    grid = OccupancyGrid(cells, RESOLUTION_M, world.origin)
    return Bench(Mapped(grid, np.zeros((1, 3)), np.zeros(3)), 3)


def test_an_emergency_stop_stops_at_once(bench):
    row = stop_on_the_way(bench, 1000, StopCause.emergency)
    assert row["in_time"]
    assert row["command_s"] <= 0.06
    assert row["reason"] == "emergency stop: pressed"
    assert row["contacts"] == 0


def test_a_killed_process_sends_nothing_and_the_vehicle_stops_itself(bench):
    row = stop_on_the_way(bench, 1000, StopCause.killed)
    assert row["in_time"]
    assert row["command_s"] is None
    assert row["vehicle_timeout_s"] == 3.0
    assert row["vehicle_timeout_s"] - 0.1 < row["stood_s"] < row["vehicle_timeout_s"] + 0.6
    assert "no zero speed sent" in told_stop(row)


def test_a_deaf_vehicle_is_noticed_long_before_it_stops(bench):
    row = stop_on_the_way(bench, 1000, StopCause.deaf)
    assert row["in_time"]
    assert row["noticed_s"] <= STOP_S
    assert "does not hear us" in row["fault"]
