"""Random plans by the thousand on any maps, each path checked a second time, in several processes."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.costmap_layers import Regions, connected
from planning.plan import PlanSettings, plan
from planning.vehicle import Vehicle
from tools.maps_at_hand import read_any_map
from tools.plan_checks import check_path
from tools.processes import in_processes
from tools.results import Report

FloatArray = NDArray[np.float64]

LEAST_M = 6.0  # between start and goal, as the crow flies
_CHUNK = 25  # plans in one task of a process
_DRAWS = 4000  # of pairs of poses, after which a map has no more


@dataclass(frozen=True, slots=True)
class Trial:
    """What is tried: vehicle, unknown space, settings of the plans, and the seed of the problems."""

    vehicle: Vehicle
    unknown: UnknownSpace
    settings: PlanSettings
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class PlanProblem:
    """Poses (3,) in the map frame at which the car fits."""

    start: FloatArray
    goal: FloatArray


def try_random_plans(
    files: Sequence[Path], count: int, trial: Trial, jobs: int, on_progress: Callable[[str], None]
) -> Report:
    """Plan `count` random problems, as many on each map as on the others, and check every path.

    Maps on which no two poses that fit are joined and LEAST_M apart are named and left out. Times are CPU seconds.
    Raises MapFileError and ToolError.
    """
    wide = [file for file in files if draw_problems(prepared(file, trial), 1, np.random.default_rng(trial.seed))]
    narrow = [str(file) for file in files if file not in wide]
    if not wide:
        return {"maps": {}, "failures": [], "narrow": narrow}
    shares = {file: len(part) for file, part in zip(wide, np.array_split(np.arange(count), len(wide)), strict=True)}
    tasks = [
        (file, first, min(_CHUNK, share - first)) for file, share in shares.items() for first in range(0, share, _CHUNK)
    ]
    rows: list[Report] = []
    for task, done in zip(tasks, in_processes(partial(_planned, trial), tasks, jobs=jobs), strict=True):
        rows += done
        solved = sum(row["solved"] for row in rows)
        on_progress(f"{task[0].stem}: {len(rows)} of {count}, {solved} solved, {sum(map(_is_bad, rows))} with faults")
    maps = {str(file): _summary([row for row in rows if row["map"] == str(file)]) for file in wide}
    failures = [row for row in rows if not row["solved"] or _is_bad(row)]
    return {"maps": maps, "all": _summary(rows), "failures": failures, "narrow": narrow}


def draw_problems(on: Costmap, count: int, random: np.random.Generator) -> list[PlanProblem]:
    """Return random problems: poses that fit, joined, LEAST_M apart; fewer where a map has hardly any.

    Joined: by a way along which the car's whole width fits beside the rear axle. The planner's regions ask for less,
    since they must never part what a car can reach; pairs that only they join have mostly no way.
    """
    half_width_m = float(np.abs(on.vehicle.corners[:, 1]).max())
    _, ways = connected(on.to_blocked_m >= half_width_m + on.grid.resolution_m / 2.0)
    rows, cols = np.nonzero(ways)
    found: list[PlanProblem] = []
    for _ in range(_DRAWS * max(count, 1) // 100 + 1 if len(rows) else 0):
        poses = _random_poses(on.grid, rows, cols, 200, random)
        starts, goals = poses[:100], poses[100:]
        far = np.hypot(*(goals - starts)[:, :2].T) >= LEAST_M
        for start, goal in zip(starts[far], goals[far], strict=True):
            if _way(on, ways, start) == _way(on, ways, goal) and on.fits(start) and on.fits(goal):
                found.append(PlanProblem(start, goal))
                if len(found) == count:
                    return found
    return found


def _random_poses(
    grid: OccupancyGrid, rows: NDArray[np.intp], cols: NDArray[np.intp], count: int, random: np.random.Generator
) -> FloatArray:
    which = random.integers(len(rows), size=count)
    inside = random.uniform(0.0, 1.0, (count, 2))
    x, y = cols[which] + inside[:, 0], rows[which] + inside[:, 1]
    local = np.column_stack([x * grid.resolution_m, y * grid.resolution_m, random.uniform(-np.pi, np.pi, count)])
    return se2.compose(grid.origin, local)


def _way(on: Costmap, ways: Regions, pose: FloatArray) -> int:
    cell = on.cell(pose)
    return int(ways[cell]) if cell else 0


@lru_cache(maxsize=1)
def prepared(file: Path, trial: Trial) -> Costmap:
    """Return the costmap of a map file, the last one kept."""
    return costmap(read_any_map(file), trial.vehicle, trial.unknown)


def _planned(trial: Trial, task: tuple[Path, int, int]) -> list[Report]:
    """Plan and check problems `first` to `first + count` of a map."""
    file, first, count = task
    on = prepared(file, trial)
    problems = draw_problems(on, count, np.random.default_rng([trial.seed, first, *file.stem.encode()]))
    return [_row(on, str(file), problem, trial) for problem in problems]


def _row(on: Costmap, name: str, problem: PlanProblem, trial: Trial) -> Report:
    result = plan(on, problem.start, problem.goal, trial.settings, seed=None, clock=time.process_time)
    row: Report = {
        "map": name,
        "start": problem.start.tolist(),
        "goal": problem.goal.tolist(),
        "solved": result.path is not None,
        "error": result.error.value if result.error else None,
        "first_s": result.first_path_s,
        "seconds": result.seconds,
    }
    if result.path is not None:
        bad = on.occupied | on.blocked if trial.unknown is UnknownSpace.forbidden else on.occupied
        faults = check_path(on.grid, bad, result.path, trial.vehicle, problem.start, problem.goal)
        row |= {"length_m": result.path.length_m, "cusps": len(result.path.cusps), "faults": asdict(faults)}
    return row


def _is_bad(row: Report) -> bool:
    return any(row.get("faults", {}).values())


def _summary(rows: Sequence[Report]) -> Report:
    """Return counts, times and the faults of some rows."""
    solved = [row for row in rows if row["solved"]]
    first_ms = [1000.0 * row["first_s"] for row in solved if row["first_s"] is not None]
    faults = {
        kind: sum(bool(row["faults"][kind]) for row in solved)
        for kind in ("colliding", "too_curved", "wrong_gears", "gaps", "ends_off")
    }
    return {
        "problems": len(rows),
        "solved": len(solved),
        "errors": dict(Counter(row["error"] for row in rows if row["error"])),
        **faults,
        "first_ms": spread(first_ms),
        "seconds": spread([row["seconds"] for row in rows]),
        "length_m": spread([row["length_m"] for row in solved]),
    }


def spread(values: Sequence[float]) -> dict[str, float] | None:
    """Return median, 95th percentile and maximum; None of nothing."""
    if not values:
        return None
    median, p95, most = np.percentile(values, [50, 95, 100]).tolist()
    return {"median": round(median, 4), "p95": round(p95, 4), "max": round(most, 4)}
