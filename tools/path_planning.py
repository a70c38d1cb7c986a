"""`plan`: a map file and two poses in, a path or the reason why there is none out."""

from __future__ import annotations

import json
import logging
import math
import time
from pathlib import Path

import numpy as np

from mapping.grid import OccupancyGrid
from mapping.map_io import read_map_with_warnings
from mapping.trajectory import Trajectory
from planning.plan import PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from tools.errors import UsageError
from tools.pictures import draw_map, write_picture
from tools.results import Report, check_run_folder, new_run_folder, writing_to

log = logging.getLogger(__name__)
Pose = tuple[float, float, float]


def plan_on_map(
    map_file: Path, start: Pose, goal: Pose, vehicle: Vehicle, settings: PlanSettings, seed: int, output: Path | None
) -> Report:
    """Plan and report; with an output folder, leave plan.json and plan.png there. Raises MapFileError, UsageError."""
    for name, pose in (("--start", start), ("--goal", goal)):
        if not all(math.isfinite(value) for value in pose):
            raise UsageError(f"{name} {pose[0]:g} {pose[1]:g} {pose[2]:g}: expected finite x and y in m and yaw in rad")
    if output is not None:
        check_run_folder(output)
    loaded = read_map_with_warnings(map_file)
    for warning in loaded.warnings:
        log.warning("%s", warning)
    result, seconds = timed_plan(loaded.grid, np.array(start), np.array(goal), vehicle, settings, seed)
    report = _report(result, seconds)
    if output is not None:
        _save(new_run_folder(output), loaded.grid, result, report)
    return report


def timed_plan(
    grid: OccupancyGrid, start: np.ndarray, goal: np.ndarray, vehicle: Vehicle, settings: PlanSettings, seed: int
) -> tuple[PlanResult, float]:
    """Return the plan and the wall time in s that it took."""
    started = time.perf_counter()
    result = plan(grid, start, goal, vehicle, settings, seed, clock=time.monotonic)
    return result, time.perf_counter() - started


def _report(result: PlanResult, seconds: float) -> Report:
    path, clearance = result.path, result.min_clearance_m
    return {
        "solved": path is not None,
        "error": result.error.nav2_name if result.error else None,
        "reason": result.reason,
        "length_m": round(path.length_m, 4) if path else None,
        "seconds": round(seconds, 4),
        "min_clearance_m": round(clearance, 4) if clearance is not None and math.isfinite(clearance) else None,
        "path": path.poses.tolist() if path else [],
        "direction": path.direction.tolist() if path else [],
        "speed_mps": path.speed_mps.round(4).tolist() if path else [],
        "advice": result.advice.tolist() if result.advice is not None else None,
    }


def _save(folder: Path, grid: OccupancyGrid, result: PlanResult, report: Report) -> None:
    poses = result.path.poses if result.path else np.empty((0, 3))
    with writing_to(folder):
        write_picture(folder / "plan.png", draw_map(grid, Trajectory(np.arange(len(poses), dtype=np.int64), poses)))
        (folder / "plan.json").write_text(json.dumps(report) + "\n", encoding="utf-8")
