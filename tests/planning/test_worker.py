"""A process that plans: the same plans as here, and what happens when it hangs, dies, or is no longer wanted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.costmap_update import Window
from planning.ends import PlanError
from planning.errors import PlanningError, WorkerError
from planning.plan import Kept, PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from planning.worker import PlanningWorker, WorkerState

QCAR = Vehicle()
DOOR = Window(50, 80, 70, 81)
PATIENT = PlanSettings(time_limit_s=60.0)


@pytest.fixture(scope="module")
def shared_worker() -> Iterator[PlanningWorker]:
    with PlanningWorker(clock=time.monotonic) as worker:
        yield worker


@pytest.fixture
def worker(shared_worker, rooms) -> PlanningWorker:
    shared_worker.set_map(rooms, QCAR, UnknownSpace.forbidden)
    return shared_worker


@pytest.fixture(scope="session")
def slit() -> OccupancyGrid:
    """Two rooms joined by a slit of 0.2 m: wide enough for the rear axle to look passable, too narrow for the car."""
    cells = np.full((120, 160), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    cells[:, 78:82] = 5.0
    cells[58:62, 78:82] = -5.0
    return OccupancyGrid(cells, 0.05, np.zeros(3))


SLIT_ENDS = np.array([1.0, 3.0, 0.0]), np.array([7.0, 3.0, 0.0])


def ends(grid: OccupancyGrid) -> tuple[np.ndarray, np.ndarray]:
    return se2.compose(grid.origin, np.array([1.0, 1.0, 0.0])), se2.compose(grid.origin, np.array([6.5, 1.5, 1.57]))


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until_gone(pid: int) -> bool:
    ends_s = time.monotonic() + 10.0
    while is_running(pid) and time.monotonic() < ends_s:
        time.sleep(0.01)
    return not is_running(pid)


class Search(threading.Thread):
    """A search that does not find anything, in a thread of its own."""

    def __init__(self, worker: PlanningWorker, settings: PlanSettings = PATIENT) -> None:
        super().__init__(daemon=True)
        self.worker, self.settings = worker, settings
        self.result: PlanResult | None = None
        self.error: BaseException | None = None
        self.start()
        while worker._searching is None and self.is_alive():
            time.sleep(0.001)
        time.sleep(0.2)  # so that the process is in the midst of it

    def run(self) -> None:
        try:
            self.result = self.worker.plan(*SLIT_ENDS, self.settings, 1)
        except BaseException as error:  # noqa: BLE001
            self.error = error

    def finished(self) -> PlanResult:
        self.join(10.0)
        assert self.error is None
        assert self.result is not None
        return self.result


def test_the_same_plans_as_in_this_process(worker, rooms):
    for seed in (3, 4):
        there = worker.plan(*ends(rooms), PlanSettings(), seed)
        known = costmap(rooms, QCAR, UnknownSpace.forbidden)
        here = plan(known, *ends(rooms), PlanSettings(), seed=seed, clock=time.monotonic)
        assert there.path is not None
        assert here.path is not None
        np.testing.assert_array_equal(there.path.poses, here.path.poses)
        np.testing.assert_array_equal(there.path.speed_mps, here.path.speed_mps)
        assert there.min_clearance_m == here.min_clearance_m


def test_the_start_is_told(worker):
    warm_up = worker.wait_until_ready()
    assert 0.0 < warm_up.kernels_s < warm_up.seconds
    assert worker.state is WorkerState.ready


def test_what_cannot_be_planned_is_said_as_here(worker, rooms):
    start, _ = ends(rooms)
    pid = worker.pid
    outside = worker.plan(start, np.array([99.0, 0.0, 0.0]), PlanSettings(), 1)
    assert outside.error is PlanError.goal_outside_map
    with pytest.raises(PlanningError, match="not a finite pose"):
        worker.plan(start, np.array([np.nan, 0.0, 0.0]), PlanSettings(), 1)
    assert worker.pid == pid


def test_a_window_that_changes_the_map_changes_the_plans(worker, rooms):
    shut = rooms.log_odds.copy()
    shut[50:70, 80] = 5.0
    assert worker.plan(*ends(rooms), PlanSettings(), 1).path is not None
    worker.update_map(OccupancyGrid(shut, rooms.resolution_m, rooms.origin), DOOR)
    assert worker.plan(*ends(rooms), PlanSettings(), 1).error is PlanError.no_valid_path
    worker.update_map(rooms, DOOR)
    assert worker.plan(*ends(rooms), PlanSettings(), 1).path is not None
    smaller = OccupancyGrid(shut[1:], rooms.resolution_m, rooms.origin)
    with pytest.raises(PlanningError, match="set_map"):
        worker.update_map(smaller, DOOR)


def test_cancel_ends_the_search_of_another_thread_and_no_later_one(worker, slit, rooms):
    worker.cancel()  # nothing to cancel: no effect on what comes
    worker.set_map(slit, QCAR, UnknownSpace.forbidden)
    search = Search(worker)
    assert worker.state is WorkerState.busy
    pid = worker.pid
    worker.cancel()
    assert search.finished().error is PlanError.cancelled
    assert worker.pid == pid  # it answered itself: nothing had to be killed
    worker.set_map(rooms, QCAR, UnknownSpace.forbidden)
    assert worker.plan(*ends(rooms), PlanSettings(), 1).path is not None


def test_a_process_that_does_not_answer_is_replaced(worker, slit):
    worker.set_map(slit, QCAR, UnknownSpace.forbidden)
    pid = worker.pid
    search = Search(worker, PlanSettings(time_limit_s=0.5))
    os.kill(pid, signal.SIGSTOP)
    stopped = search.finished()
    assert stopped.error is PlanError.timeout
    assert "killed" in stopped.reason
    assert worker.pid != pid
    assert wait_until_gone(pid)
    # The map is known to the new process too.
    assert worker.plan(*SLIT_ENDS, PlanSettings(time_limit_s=0.1), 1).error is PlanError.timeout

    pid = worker.pid
    search = Search(worker)
    os.kill(pid, signal.SIGSTOP)
    worker.cancel()
    assert search.finished().error is PlanError.cancelled
    assert worker.pid != pid


def test_a_cancelled_start_is_no_reason_to_start_again(slit):
    with PlanningWorker(clock=time.monotonic) as worker:
        pid = worker.pid
        assert worker.state is WorkerState.starting
        search = Search(worker)
        worker.cancel()
        assert search.finished().error is PlanError.cancelled
        assert worker.pid == pid
    assert worker.state is WorkerState.closed
    assert wait_until_gone(pid)
    with pytest.raises(WorkerError, match="closed"):
        worker.plan(*SLIT_ENDS, PATIENT)


def test_a_crash_is_an_error_and_the_next_plan_works(worker, slit, rooms):
    worker.set_map(slit, QCAR, UnknownSpace.forbidden)
    search = Search(worker)
    os.kill(worker.pid, signal.SIGKILL)
    search.join(10.0)
    assert isinstance(search.error, WorkerError)
    assert "killed by signal 9" in str(search.error)
    assert worker.plan(*SLIT_ENDS, PlanSettings(time_limit_s=0.1), 1).error is PlanError.timeout
    # One that dies between two requests is not missed.
    os.kill(worker.pid, signal.SIGKILL)
    os.waitid(os.P_PID, worker.pid, os.WEXITED | os.WNOWAIT)
    worker.set_map(rooms, QCAR, UnknownSpace.forbidden)
    assert worker.plan(*ends(rooms), PlanSettings(), 1).path is not None


def test_many_plans_leave_nothing_behind(worker, rooms):
    def held() -> tuple[int, int, int, int]:
        fds = (len(os.listdir(f"/proc/{pid}/fd")) for pid in ("self", worker.pid))  # noqa: PTH208
        threads = len(os.listdir(f"/proc/{worker.pid}/task"))  # noqa: PTH208
        return (*fds, threads, threading.active_count())  # type: ignore[return-value]

    start, goal = ends(rooms)[0], se2.compose(rooms.origin, np.array([2.5, 1.0, 0.0]))
    assert worker.plan(start, goal, PlanSettings(), 1).path is not None
    before = held()
    for seed in range(50):
        worker.plan(start, goal, PlanSettings(), seed)
    assert held() == before


PROGRAM = """
import signal, sys, time
import numpy as np
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.costmap_update import Window
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from planning.worker import PlanningWorker
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore it
cells = np.load(sys.argv[1])
with PlanningWorker(clock=time.monotonic) as worker:
    worker.set_map(OccupancyGrid(cells, 0.05, np.zeros(3)), Vehicle(), UnknownSpace.forbidden)
    print(worker.pid, flush=True)
    try:
        worker.plan(np.array([1.0, 3.0, 0.0]), np.array([7.0, 3.0, 0.0]), PlanSettings(time_limit_s=60.0), 1)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_the_process_ends_with_its_parent(slit, tmp_path, project_root, number):
    np.save(tmp_path / "slit.npy", slit.log_odds)
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, tmp_path / "slit.npy"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(project_root)},
    )
    assert process.stdout is not None
    pid = int(process.stdout.readline())
    time.sleep(0.3)
    os.killpg(process.pid, number)  # as a terminal does, to all that run in it
    out, err = process.communicate(timeout=60)
    assert wait_until_gone(pid)
    assert err == ""
    assert (process.returncode, out) == ((0, "interrupted\n") if number == signal.SIGINT else (-number, ""))


def test_a_path_is_mended_there_as_here(worker, rooms):
    settings = PlanSettings(iterations=5)
    path = worker.plan(*ends(rooms), settings, seed=2).path
    assert path is not None
    kept = worker.replan(path, 20, settings, seed=2)
    assert kept.kept is Kept.all
    np.testing.assert_array_equal(kept.path.poses, path.poses[20:])
    cells = rooms.log_odds.copy()
    cells[DOOR.cells] = 5.0
    worker.update_map(OccupancyGrid(cells, rooms.resolution_m, rooms.origin), DOOR)
    assert worker.replan(path, 20, settings, seed=2).error is PlanError.no_valid_path
