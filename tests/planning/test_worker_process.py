"""What the process answers, asked in this one."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from mapping import se2
from planning.costmap import UnknownSpace
from planning.costmap_update import Window
from planning.ends import PlanError
from planning.plan import PlanResult, PlanSettings
from planning.vehicle import Vehicle
from planning.worker_process import Answers, ChangedWindow, MapReady, NewMap, Order, Refusal


def wanted() -> bool:
    return False


@pytest.fixture
def answers(rooms) -> Answers:
    answers = Answers(time.monotonic)
    assert isinstance(answers.to(NewMap(rooms, Vehicle(), UnknownSpace.forbidden), wanted), MapReady)
    return answers


def order(rooms, goal: tuple[float, ...] = (2.5, 1.0, 0.0)) -> Order:
    poses = se2.compose(rooms.origin, np.array([[1.0, 1.0, 0.0], goal]))
    return Order(poses[0], poses[1], PlanSettings(), 1)


def test_a_plan_needs_a_map(rooms):
    refusal = Answers(time.monotonic).to(order(rooms), wanted)
    assert isinstance(refusal, Refusal)
    assert refusal.foreseen
    assert "set_map" in refusal.text


def test_a_plan_and_an_error_are_results(answers, rooms):
    found, refused = answers.to(order(rooms), wanted), answers.to(order(rooms, (4.02, 1.0, 0.0)), wanted)
    assert isinstance(found, PlanResult)
    assert found.path is not None
    assert isinstance(refused, PlanResult)
    assert refused.error is PlanError.goal_occupied


def test_what_nobody_has_foreseen_is_answered_with_its_traceback(answers, rooms):
    nonsense = Order(np.zeros(2), np.zeros(3), PlanSettings(), 1)
    refusal = answers.to(nonsense, wanted)
    assert isinstance(refusal, Refusal)
    assert not refusal.foreseen
    assert "Traceback" in refusal.text
    assert isinstance(answers.to(order(rooms), wanted), PlanResult)


def test_a_window_changes_its_cells_only(answers, rooms):
    wall = np.full((118, 1), 5.0, np.float32)
    assert isinstance(answers.to(ChangedWindow(Window(1, 35, 119, 36), wall), wanted), MapReady)
    blocked = answers.to(order(rooms), wanted)
    assert isinstance(blocked, PlanResult)
    assert blocked.error is PlanError.no_valid_path


def test_a_map_that_cannot_be_taken_over_leaves_no_old_one(answers, rooms):
    refusal = answers.to(ChangedWindow(Window(0, 0, 2, 2), np.zeros((3, 3), np.float32)), wanted)
    assert isinstance(refusal, Refusal)
    after = answers.to(order(rooms), wanted)
    assert isinstance(after, Refusal)
    assert "set_map" in after.text


def test_after_the_warm_up_nothing_is_compiled_any_more():
    program = """
import gc, pickle, time
import numpy as np
from numba.core.dispatcher import Dispatcher
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from planning.worker_process import Answers, NewMap, Order, warm_up
def kernels():
    return {(d.__module__, d.__name__): len(d.signatures) for d in gc.get_objects() if isinstance(d, Dispatcher)}
warm_up(time.monotonic)
warm = kernels()
cells = np.full((160, 160), -5.0, np.float32)
cells[:100, 80] = 5.0
grid = OccupancyGrid(cells, 0.05, np.array([1.0, 2.0, 0.3]))
for unknown in UnknownSpace:
    answers = Answers(time.monotonic)
    answers.to(pickle.loads(pickle.dumps(NewMap(grid, Vehicle(margin_m=0.02), unknown))), lambda: False)
    for goal in ([3.0, 7.0, 1.0], [40.0, 0.0, 0.0]):
        order = Order(np.array([3.0, 4.0, 0.5]), np.array(goal), PlanSettings(iterations=60), 3)
        answers.to(pickle.loads(pickle.dumps(order)), lambda: False)
print(sorted(set(kernels().items()) - set(warm.items())), len(warm))
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    later, _, count = ran.stdout.strip().rpartition(" ")
    assert later == "[]"
    assert int(count) > 20
