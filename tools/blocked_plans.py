"""Problems without a solution, made on any map: ends off it, in walls and in unknown space, and ends walled in.

What the planner must answer follows from how a problem was made; every answer is timed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ends import PlanError
from planning.plan import plan
from tools.plan_checks import colliding_poses
from tools.plan_trials import PlanProblem, Trial, draw_problems, prepared, spread
from tools.results import Report

FloatArray = NDArray[np.float64]

LONGEST_S = 0.05
A_MAP = 30
_OUTSIDE, _WALLS, _UNKNOWN = 8, 10, 6  # problems of a map; those that it has no room for, and the rest, are walled in
_TRIES = 3000
_SPARE_CELLS = 3  # between the car that is walled in and the wall
_WALL = np.float32(5.0)


@dataclass(frozen=True, slots=True, eq=False)
class BlockedProblem:
    """A problem on a map, how it was made, and what must be answered."""

    on: Costmap
    made: str
    problem: PlanProblem
    expected: PlanError


def try_blocked_plans(files: Sequence[Path], trial: Trial, on_progress: Callable[[str], None]) -> Report:
    """Plan A_MAP problems without a solution on each map; times are CPU seconds, the costmap ready.

    Maps on which no two poses that fit are joined and far enough apart are named and left out. Raises MapFileError and
    ToolError.
    """
    rows: list[Report] = []
    narrow: list[str] = []
    for file in files:
        on = prepared(file, trial)
        random = np.random.default_rng([trial.seed, *file.stem.encode()])
        problems = list(islice(blocked_problems(on, random), A_MAP))
        if not problems:
            narrow.append(str(file))
            continue
        if not rows:  # compiled before the clock runs
            for each in problems:
                _answer(each, trial)
        answers = [{"map": str(file), **_answer(each, trial)} for each in problems]
        rows += answers
        slowest = max(row["seconds"] for row in answers)
        right = sum(row["right"] for row in answers)
        on_progress(f"{file.stem}: {right} of {len(answers)} right, the slowest in {1000.0 * slowest:.1f} ms")
    seconds = [row["seconds"] for row in rows]
    return {
        "problems": len(rows),
        "right": sum(row["right"] for row in rows),
        "late": sum(value > LONGEST_S for value in seconds),
        "bad_advice": sum(row["advice_fits"] is False for row in rows),
        "seconds": spread(seconds),
        "rows": rows,
        "narrow": narrow,
    }


def blocked_problems(on: Costmap, random: np.random.Generator) -> Iterator[BlockedProblem]:
    """Yield problems without a solution: _OUTSIDE, _WALLS and _UNKNOWN of those kinds, then ends that are walled in.

    None on a map without two good poses far apart.
    """
    good = draw_problems(on, A_MAP, random)
    if not good:
        return
    kinds = (
        ("outside the map", "outside_map", _outside(on, random), _OUTSIDE),
        ("in a wall", "occupied", _in_walls(on, random), _WALLS),
        ("in unknown space", "in_unknown_space", _in_unknown_space(on, random), _UNKNOWN),
    )
    number = 0
    for made, error, bad_poses, count in kinds:
        for bad in islice(bad_poses, count):
            ends = good[number % len(good)]
            end = ("start", "goal")[number % 2]
            yield BlockedProblem(on, f"{end} {made}", replace(ends, **{end: bad}), PlanError[f"{end}_{error}"])
            number += 1
    while True:
        ends = good[number % len(good)]
        end = ("start", "goal")[number % 2]
        walled = costmap(walled_in(on.grid, getattr(ends, end), on.vehicle.outer_radius_m), on.vehicle, on.unknown)
        yield BlockedProblem(walled, f"{end} walled in", ends, PlanError.no_valid_path)
        number += 1


def walled_in(grid: OccupancyGrid, pose: FloatArray, radius_m: float) -> OccupancyGrid:
    """Return the grid with a square wall, one cell thick, around a pose (3,), out of reach of a circle about it."""
    col, row = np.floor(grid.cell_coordinates(pose[np.newaxis, :2])[0]).astype(np.int64).tolist()
    half = int(np.ceil(radius_m / grid.resolution_m)) + _SPARE_CELLS
    rows, cols = (np.abs(np.arange(size) - at) for size, at in zip(grid.log_odds.shape, (row, col), strict=True))
    log_odds = grid.log_odds.copy()
    log_odds[np.maximum.outer(rows, cols) == half] = _WALL
    return replace(grid, log_odds=log_odds)


def _outside(on: Costmap, random: np.random.Generator) -> Iterator[FloatArray]:
    """Yield poses up to 20 m off the map, to each side."""
    width_m, height_m = on.size_m
    while True:
        for side in range(4):
            along, off_m = random.uniform(0.0, 1.0), random.uniform(0.01, 20.0)
            x = (-off_m, width_m + off_m, along * width_m, along * width_m)[side]
            y = (along * height_m, along * height_m, -off_m, height_m + off_m)[side]
            yield se2.compose(on.grid.origin, np.array([x, y, random.uniform(-np.pi, np.pi)]))


def _in_walls(on: Costmap, random: np.random.Generator) -> Iterator[FloatArray]:
    """Yield poses at which the car overlaps an occupied cell: its rear axle there, or its nose only."""
    nose = np.array([float(on.vehicle.body[:, 0].max()) - on.grid.resolution_m, 0.0, 0.0])
    cells = np.argwhere(on.occupied)
    for number in range(_TRIES if len(cells) else 0):
        pose = _at_cell(on, cells[random.integers(len(cells))], random)
        if number % 2:
            pose = se2.compose(pose, se2.inverse(nose))
        if on.cell(pose) is not None and colliding_poses(on.grid, on.occupied, pose[np.newaxis], on.vehicle.body):
            yield pose


def _in_unknown_space(on: Costmap, random: np.random.Generator) -> Iterator[FloatArray]:
    """Yield poses at which the car overlaps forbidden unknown space, and no occupied cell even with its margin."""
    cells = np.argwhere(on.blocked & ~on.occupied)
    if on.unknown is not UnknownSpace.forbidden or len(cells) == 0:
        return
    for _ in range(_TRIES):
        pose = _at_cell(on, cells[random.integers(len(cells))], random)
        here = pose[np.newaxis]
        if not colliding_poses(on.grid, on.occupied, here, on.vehicle.corners) and colliding_poses(
            on.grid, on.blocked, here, on.vehicle.body
        ):
            yield pose


def _at_cell(on: Costmap, cell: NDArray[np.intp], random: np.random.Generator) -> FloatArray:
    row, col = cell.tolist()
    x, y = (np.array([col, row]) + random.uniform(0.0, 1.0, 2)) * on.grid.resolution_m
    return se2.compose(on.grid.origin, np.array([x, y, random.uniform(-np.pi, np.pi)]))


def _answer(each: BlockedProblem, trial: Trial) -> Report:
    ends = each.problem
    result = plan(each.on, ends.start, ends.goal, trial.settings, seed=None, clock=time.process_time)
    advice_fits = None
    if result.advice is not None:
        blocked, body = each.on.blocked, each.on.vehicle.body
        advice_fits = not colliding_poses(each.on.grid, blocked, result.advice[np.newaxis], body)
    return {
        "made": each.made,
        "start": ends.start.tolist(),
        "goal": ends.goal.tolist(),
        "expected": each.expected.value,
        "error": result.error.value if result.error else None,
        "right": result.error is each.expected,
        "seconds": result.seconds,
        "advice_fits": advice_fits,
    }
