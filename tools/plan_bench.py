"""What plans cost and how long their paths are, beside OMPL with numpy; what starting costs and what plans leave."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.map_io import read_map
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.plan import Planner, PlanSettings, plan
from planning.vehicle import Vehicle
from planning.worker import PlanningWorker
from tools.plan_checks import check_path
from tools.plan_peer import plan_by_peer
from tools.plan_problems import TimedProblem, map_beside, read_problems
from tools.plan_trials import spread
from tools.processes import memory
from tools.results import Report

FloatArray = NDArray[np.float64]

REF_CAR = Vehicle(turning_radius_m=0.443, margin_m=0.0, reverse_cost=1.0, cusp_cost_m=0.0)
_PEER_LIMIT_S = 5.0
_CANCEL_AFTER_S = (0.0, 0.25)  # a search is cancelled at a random time in between
_LONG = PlanSettings(Planner.rrt_star, budget_s=60.0, time_limit_s=60.0)  # of a search that only being cancelled ends
_START = "import time; from planning.worker_process import warm_up; warm_up(time.monotonic)"
_WARMING = 200  # plans before memory is first looked at
_ASK_S = 0.3  # after a plan is asked for, until Ctrl-C


@dataclass(frozen=True, slots=True)
class Contender:
    """A planner with a car; planner None: OMPL with numpy."""

    name: str
    vehicle: Vehicle
    planner: Planner | None = Planner.car


CONTENDERS = (
    Contender("car, as ref: R 0.443 m, no margin, every metre 1", REF_CAR),
    Contender("car, R 0.443 m, costs and margin as shipped", Vehicle(turning_radius_m=0.443)),
    Contender("car, as shipped: R 0.576 m", Vehicle()),
    Contender("rrt_connect, R 0.443 m, no margin", REF_CAR, Planner.rrt_connect),
    Contender("peer: OMPL RRT-Connect and numpy, R 0.443 m", REF_CAR, None),
)


def bench_plans(file: Path, unknown: UnknownSpace, on_progress: Callable[[str], None]) -> Iterator[Report]:
    """Yield a row for each contender and map <name>.yaml beside the file: CPU times, the costmap and kernels ready."""
    problems = read_problems(file)
    grids = {name: read_map(map_beside(file, name)) for name in problems}
    for contender in CONTENDERS:
        for name, listed in problems.items():
            on = costmap(grids[name], contender.vehicle, unknown)
            _solved(on, listed[0], contender)  # compiled before the clock runs
            rows = [row for row in (_solved(on, each, contender) for each in listed) if row is not None]
            report: Report = {"contender": contender.name, "map": name, "problems": len(listed), "solved": len(rows)}
            for key in ("first_ms", "ratio", "seconds"):
                report[key] = spread([row[key] for row in rows])
            report["faults"] = sum(bool(row["faults"]) for row in rows) if contender.planner else None
            on_progress(f"{contender.name}, {name}: {len(rows)} of {len(listed)}")
            yield report


def _solved(on: Costmap, problem: TimedProblem, contender: Contender) -> dict[str, float] | None:
    ends = problem.start, problem.goal
    if contender.planner is None:
        found = plan_by_peer(on, *ends, limit_s=_PEER_LIMIT_S, seed=0, clock=time.process_time)
        if found is None:
            return None
        ratio = found.length_m / problem.ref_m
        return {"first_ms": 1e3 * found.first_s, "ratio": ratio, "seconds": found.seconds, "faults": 0}
    settings = PlanSettings(planner=contender.planner)
    result = plan(on, *ends, settings, seed=None, clock=time.process_time)
    if result.path is None:
        return None
    faults = check_path(on.grid, on.occupied, result.path, contender.vehicle, *ends)
    first_s = result.seconds if result.first_path_s is None else result.first_path_s
    ratio = result.path.length_m / problem.ref_m
    return {"first_ms": 1e3 * first_s, "ratio": ratio, "seconds": result.seconds, "faults": float(faults.any)}


def bench_start() -> Report:
    """Return the wall and CPU seconds from a process's start until it can plan: compiling first, and compiled."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        return {name: _started(environment) for name in ("first", "second")}


def _started(environment: dict[str, str]) -> Report:
    before, began = os.times(), time.perf_counter()
    subprocess.run([sys.executable, "-c", _START], env=environment, check=True)  # noqa: S603 - this program itself
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return {"wall_s": round(time.perf_counter() - began, 2), "cpu_s": round(cpu_s, 2)}


def bench_leaks(file: Path, unknown: UnknownSpace, plans: int) -> Report:
    """Return what this process holds before and after so many plans on the first map, OMPL's among them."""
    name, listed = next(iter(read_problems(file).items()))
    on = costmap(read_map(map_beside(file, name)), Vehicle(), unknown)
    kinds = (Planner.car, Planner.car, Planner.rrt_connect)
    settings = [PlanSettings(planner=kind, budget_s=0.01, time_limit_s=1.0) for kind in kinds]
    held = []
    for number in range(plans + _WARMING):  # the first ones fill what is kept for later: pools of memory, caches
        if number in (0, _WARMING):
            held.append(_held())
        problem = listed[number % len(listed)]
        plan(on, problem.start, problem.goal, settings[number % len(kinds)], seed=number, clock=time.process_time)
    held.append(_held())
    return {"plans": plans, "before": held[1], "after": held[2], "first_half": held[0]}


def _held() -> Report:
    """Return resident memory, open descriptors and threads."""
    return {
        "resident_mb": round(memory().resident_mb, 1),
        "descriptors": sum(1 for _ in Path("/proc/self/fd").iterdir()),
        "threads": sum(1 for _ in Path("/proc/self/task").iterdir()),
    }


def bench_cancel(file: Path, unknown: UnknownSpace, times: int) -> Report:
    """Return how long after being cancelled, and after Ctrl-C, plans of a worker come back, in ms of wall time."""
    problems = read_problems(file)
    name, listed = list(problems.items())[-1]
    grid = read_map(map_beside(file, name))
    random = np.random.default_rng(0)
    late: dict[str, list[float]] = {"cancel": [], "ctrl_c": []}
    with PlanningWorker(clock=time.monotonic) as worker, _with_ctrl_c():
        worker.set_map(grid, Vehicle(), unknown)
        for number in range(times):
            problem = listed[number % len(listed)]
            late["cancel"].append(_until_back(worker, problem, random.uniform(*_CANCEL_AFTER_S), worker.cancel))
        for number in range(max(times // 10, 1)):
            worker.set_map(grid, Vehicle(), unknown)
            problem = listed[number % len(listed)]
            late["ctrl_c"].append(_until_back(worker, problem, _ASK_S, _press_ctrl_c))
    return {key: spread(values) for key, values in late.items()} | {"times": times}


@contextmanager
def _with_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C be a KeyboardInterrupt also where a shell has this process ignore it, as it does in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _press_ctrl_c() -> None:
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # which waits, as at a terminal


def _until_back(worker: PlanningWorker, problem: TimedProblem, after_s: float, stop: Callable[[], object]) -> float:
    """Ask for a plan that takes long, stop it after a while, and return the ms until the call was over."""
    stopped: list[float] = []

    def stop_it() -> None:
        stopped.append(time.perf_counter())
        stop()

    timer = threading.Timer(after_s, stop_it)
    timer.start()
    with suppress(KeyboardInterrupt):
        worker.plan(problem.start, problem.goal, _LONG)
    over = time.perf_counter()
    timer.join()
    return 1e3 * max(over - stopped[0], 0.0)


def cpu_name() -> str:
    """Return the processor's name, as Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return "unknown"
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")
