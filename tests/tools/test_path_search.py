"""Looking for paths, here and beside: the same answers, questions that replace others, and processes that die."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace
from planning.ends import PlanError
from planning.plan import PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from tools.path_search import PathAnswer, PathSearch, PathSearchBeside, PathSearchHere, PathWanted

START, GOAL = np.array([1.0, 1.0, 0.0]), np.array([6.5, 1.5, 1.57])
MARGINS_M = (0.2, 0.02)


def rooms(gap_cells: int) -> OccupancyGrid:
    """Two rooms of 4 m x 6 m, joined by a gap of so many cells of 0.05 m."""
    cells = np.full((120, 160), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    cells[:, 78:82] = 5.0
    cells[58 : 58 + gap_cells, 78:82] = -5.0
    return OccupancyGrid(cells, 0.05, np.zeros(3))


def wanted(gap_cells: int = 20, goal=GOAL) -> PathWanted:
    return PathWanted(rooms(gap_cells), Vehicle(), MARGINS_M, UnknownSpace.forbidden, START, goal)


def find(known, start, goal) -> PlanResult:
    return plan(known, start, goal, PlanSettings(iterations=5), seed=1, clock=lambda: 0.0)


def answer_of(search: PathSearch, seconds: float = 60.0) -> PathAnswer:
    ends_s = time.monotonic() + seconds
    while time.monotonic() < ends_s:
        answer = search.answer()
        if answer is not None:
            return answer
        time.sleep(0.01)
    raise AssertionError(f"no answer within {seconds} s")


@pytest.fixture(scope="module")
def beside():
    with PathSearchBeside(time.monotonic, PlanSettings(budget_s=0.1, time_limit_s=5.0)) as search:
        yield search


@pytest.fixture(params=["here", "beside"])
def search(request, beside):
    return PathSearchHere(find) if request.param == "here" else beside


def test_each_question_is_answered_once(search):
    assert search.answer() is None
    search.ask(wanted())
    answer = answer_of(search, 300.0)  # the first one waits for what is compiled
    assert answer.result.path is not None
    np.testing.assert_allclose(answer.result.path.poses[[0, -1]], [START, GOAL], atol=1e-6)
    assert answer.margin_m == MARGINS_M[0]
    assert search.answer() is None


def test_the_first_margin_that_leaves_a_path_counts(search):
    search.ask(wanted(gap_cells=10))  # 0.5 m, of which the car needs 0.592 m with the first margin
    answer = answer_of(search)
    assert answer.result.path is not None
    assert answer.margin_m == MARGINS_M[1]


def test_a_goal_in_a_wall_is_an_answer_in_words(search):
    search.ask(wanted(goal=np.array([4.0, 1.0, 0.0])))
    answer = answer_of(search)
    assert answer.result.path is None
    assert answer.margin_m is None
    assert answer.result.error is PlanError.goal_occupied
    assert "goal" in answer.result.reason


def test_what_is_no_request_is_an_answer_beside(beside):
    beside.ask(wanted(goal=np.array([np.nan, 1.0, 0.0])))
    assert "not a finite pose" in answer_of(beside).result.reason
    beside.ask(wanted())
    assert answer_of(beside).result.path is not None


def test_here_answers_come_as_late_as_wanted():
    search = PathSearchHere(find, late=2)
    search.ask(wanted())
    assert search.answer() is None
    assert search.answer() is None
    assert search.answer() is not None


def test_a_question_replaces_the_one_before_at_once(beside):
    beside.ask(wanted(gap_cells=4))  # 0.2 m looks passable and is not: searched for until the time is up
    time.sleep(0.3)
    began_s = time.monotonic()
    beside.ask(wanted(goal=np.array([2.0, 1.0, 0.0])))
    answer = answer_of(beside)
    assert answer.result.path is not None
    np.testing.assert_allclose(answer.result.path.poses[-1], [2.0, 1.0, 0.0], atol=1e-6)
    assert time.monotonic() - began_s < 3.0
    assert beside.answer() is None


def test_a_process_that_dies_is_an_answer_and_the_next_question_finds_another(beside):
    beside.ask(wanted(gap_cells=4))
    time.sleep(0.3)
    os.kill(beside._worker.pid, signal.SIGKILL)
    answer = answer_of(beside)
    assert answer.result.path is None
    assert "killed by signal 9" in answer.result.reason
    beside.ask(wanted())
    assert answer_of(beside).result.path is not None


def test_it_closes_while_its_process_is_starting():
    search = PathSearchBeside(time.monotonic)
    search.ask(wanted())
    began_s = time.monotonic()
    search.close()
    search.close()
    assert time.monotonic() - began_s < 2.0
    assert search.answer() is None
