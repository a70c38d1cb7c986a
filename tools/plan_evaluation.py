"""`evaluate plans`: how many of a set of problems a planner solves, and whether a second opinion finds a collision."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mapping.map_io import read_map
from planning.costmap import UnknownSpace, costmap
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from planning.worker_process import warm_up
from tools.path_planning import timed_plan
from tools.plan_checks import colliding_poses
from tools.plan_problems import map_beside, read_problems
from tools.results import Report


def evaluate_plans(
    problems_file: Path,
    vehicle: Vehicle,
    unknown: UnknownSpace,
    settings: PlanSettings,
    seed: int,
    on_progress: Callable[[str], None],
) -> Report:
    """Plan each problem of a file {map: [{start, goal, ref}, ...]} on <map>.yaml beside it.

    ref is a length in m that a path is compared with. Raises ToolError and MapFileError.
    """
    problems = read_problems(problems_file)
    costmaps = {name: costmap(read_map(map_beside(problems_file, name)), vehicle, unknown) for name in problems}
    warm_up(time.monotonic)  # before the clock runs
    rows = []
    for number, (name, each) in enumerate((name, each) for name, listed in problems.items() for each in listed):
        result, seconds = timed_plan(costmaps[name], each.start, each.goal, settings, seed)
        row: Report = {"map": name, "problem": number, "solved": result.path is not None, "seconds": round(seconds, 4)}
        row["error"] = result.error.nav2_name if result.error else None
        row["reason"] = result.reason
        if result.path is not None:
            row["length_over_ref"] = round(result.path.length_m / each.ref_m, 4)
            grid = costmaps[name].grid
            row["colliding_poses"] = colliding_poses(grid, grid.occupied, result.path.poses, vehicle.body)
        rows.append(row)
        on_progress(f"{name} {number}: {'solved' if row['solved'] else row['error']} in {seconds:.2f} s")
    return {"planner": settings.planner.value, "maps": {name: _summary(rows, name) for name in problems}, "rows": rows}


def _summary(rows: list[Report], name: str) -> Report:
    mine = [row for row in rows if row["map"] == name]
    solved = [row for row in mine if row["solved"]]
    seconds, ratios = [row["seconds"] for row in mine], [row["length_over_ref"] for row in solved]
    return {
        "problems": len(mine),
        "solved": len(solved),
        "colliding_paths": sum(row["colliding_poses"] > 0 for row in solved),
        "seconds_median": round(float(np.median(seconds)), 4),
        "seconds_p95": round(float(np.percentile(seconds, 95)), 4),
        "length_over_ref_median": round(float(np.median(ratios)), 3) if ratios else None,
        "length_over_ref_p95": round(float(np.percentile(ratios, 95)), 3) if ratios else None,
    }
