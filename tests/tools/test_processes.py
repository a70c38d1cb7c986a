from __future__ import annotations

import math
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.recording_reader import open_recording
from tools.errors import ToolError
from tools.processes import as_finished, in_own_process, in_processes, limit_to, memory, reset_peak, thread_times


def test_work_is_done_in_another_process_each_time():
    first, second = in_own_process(os.getpid), in_own_process(os.getpid)
    assert len({first, second, os.getpid()}) == 3


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_shared_by_processes_come_back_in_their_order(jobs):
    assert list(in_processes(pow, [2, 3, 4], [5, 4, 3], jobs=jobs)) == [32, 81, 64]
    done_by = set(in_processes(os.path.realpath, ["/proc/self"] * 3, jobs=jobs, first=(time.sleep, (0.0,))))
    assert (os.path.realpath("/proc/self") in done_by) == (jobs == 1)


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_is_finished_comes_back_at_once_by_its_key(jobs):
    tasks = {"slow": (0.6,), "quick": (0.0,), "other": (0.0,)}
    finished = [key for key, _ in as_finished(time.sleep, tasks, jobs=jobs, first=(time.sleep, (0.0,)), here=bool)]
    assert sorted(finished) == sorted(tasks)
    assert (finished[-1] == "slow") == (jobs == 2)
    assert dict(as_finished(pow, {"a": (2, 5), "b": (3, 4)}, jobs=jobs, first=(time.sleep, (0.0,)), here=bool)) == {
        "a": 32,
        "b": 81,
    }


def test_a_shared_process_that_dies_is_one_clear_error():
    with pytest.raises(ToolError, match="memory"):
        list(as_finished(os._exit, {1: (9,), 2: (9,)}, jobs=2, first=(time.sleep, (0.0,)), here=bool))
    with pytest.raises(ToolError, match="memory"):
        list(in_processes(os._exit, [9, 9], jobs=2))


def test_an_error_comes_back_as_it_was(tmp_path):
    with pytest.raises(Exception, match=r"nothing\.mcap") as here:
        open_recording(tmp_path / "nothing.mcap")
    with pytest.raises(type(here.value), match=r"nothing\.mcap"):
        in_own_process(open_recording, tmp_path / "nothing.mcap")


def test_a_process_that_dies_is_one_clear_error():
    with pytest.raises(ToolError, match="memory"):
        in_own_process(os._exit, 9)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from Linux's /proc")
def test_the_peak_remembers_what_was_let_go_until_it_is_reset():
    block = np.ones(25_000_000)  # 200 MB
    held = memory()
    del block
    after = memory()
    assert after.peak_mb >= held.resident_mb - 1.0
    assert after.resident_mb < held.resident_mb - 150.0
    if reset_peak():
        assert memory().peak_mb < after.peak_mb - 150.0
    assert not math.isnan(after.peak_mb)


def test_a_thread_s_time_is_its_own():
    end = threading.Event()

    def work():
        while not end.is_set():
            sum(range(1000))

    before = thread_times()
    busy = [threading.Thread(target=work, name=f"busy_{number}") for number in range(2)]
    for thread in busy:
        thread.start()
    began = time.thread_time()
    while thread_times()["busy"] < 0.2:
        time.sleep(0.01)
    own_s = time.thread_time() - began
    after = thread_times()
    end.set()
    for thread in busy:
        thread.join()
    assert "busy" not in before
    assert after["MainThread"] - before["MainThread"] == pytest.approx(own_s, abs=0.05)
    assert "busy" not in thread_times()


def test_a_process_can_be_limited_to_a_core():
    assert in_own_process(limit_to, 1) == 1
