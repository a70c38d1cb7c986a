"""`plan`: a map file and two poses in, a path or the reason why there is none out."""

from __future__ import annotations

import json
import logging
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Recordable
from drivers.recording_writer import McapRecorder, library
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace
from planning.plan import PlanResult, PlanSettings, plan
from planning.worker import PlanningWorker
from tools.clock import RunClock
from tools.errors import ToolError, UsageError
from tools.map_reading import read_saved
from tools.pictures import Image, write_picture
from tools.plan_picture import draw_plan
from tools.planning_config import PlanningSection
from tools.results import Report, check_run_folder, grid_snapshot, new_run_folder, writing_to

log = logging.getLogger(__name__)
FloatArray = NDArray[np.float64]
Pose = tuple[float, float, float]


def plan_on_map(
    worker: PlanningWorker,
    map_file: Path,
    start: Pose,
    goal: Pose,
    section: PlanningSection,
    *,
    seed: int | None = None,
    output: Path | None = None,
) -> Report:
    """Plan and report; with an output folder, leave plan.json, plan.png and plan.mcap there.

    worker: may be warming up still. Raises MapFileError, UsageError, ToolError, PlanningError.
    """
    for name, pose in (("--start", start), ("--goal", goal)):
        if not all(math.isfinite(value) for value in pose):
            raise UsageError(f"{name} {pose[0]:g} {pose[1]:g} {pose[2]:g}: expected finite x and y in m and yaw in rad")
    if output is not None:
        check_run_folder(output)
        if map_file.stem == "plan" and map_file.resolve().parent == output.resolve():
            raise ToolError(f"{output}: holds {map_file.name}, whose image plan.png could be: name another folder")
    grid, ends = read_saved(map_file), (np.array(start), np.array(goal))
    worker.set_map(grid, section.vehicle(), UnknownSpace(section.unknown))
    started = time.perf_counter()
    result = worker.plan(*ends, section.plan_settings(), seed)
    seconds = time.perf_counter() - started
    if result.path is not None:
        result = replace(result, path=result.path.at_speed(section.speed.limits()))
    report = _report(result, seconds)
    if output is not None:
        _save(new_run_folder(output), grid, draw_plan(grid, *ends, result, section.vehicle()), result, report)
    return report


def timed_plan(
    known: Costmap, start: FloatArray, goal: FloatArray, settings: PlanSettings, seed: int | None
) -> tuple[PlanResult, float]:
    """Return the plan, made in this process, and the wall time in s that it took."""
    started = time.perf_counter()
    result = plan(known, start, goal, settings, seed=seed, clock=time.monotonic)
    return result, time.perf_counter() - started


def _report(result: PlanResult, seconds: float) -> Report:
    path, clearance = result.path, result.min_clearance_m
    return {
        "solved": path is not None,
        "error": result.error.nav2_name if result.error else None,
        "reason": result.reason,
        "length_m": round(path.length_m, 4) if path else None,
        "seconds": round(seconds, 4),
        "first_path_s": None if result.first_path_s is None else round(result.first_path_s, 4),
        "iterations": result.iterations,
        "ended_by": result.ended_by.value if result.ended_by else None,
        "min_clearance_m": round(clearance, 4) if clearance is not None and math.isfinite(clearance) else None,
        "path": path.poses.tolist() if path else [],
        "direction": path.direction.tolist() if path else [],
        "speed_mps": path.speed_mps.round(4).tolist() if path else [],
        "cusps": path.cusps.tolist() if path else [],
        "advice": result.advice.tolist() if result.advice is not None else None,
    }


def _save(folder: Path, grid: OccupancyGrid, picture: Image, result: PlanResult, report: Report) -> None:
    """Leave the plan in the folder, in place of an earlier one."""
    recording = folder / "plan.mcap"
    with writing_to(folder):
        write_picture(folder / "plan.png", picture)
        (folder / "plan.json").write_text(json.dumps(report) + "\n", encoding="utf-8")
        recording.unlink(missing_ok=True)
    stamp_ns = RunClock()()
    messages: list[Recordable] = [grid_snapshot(grid, stamp_ns)]
    if result.path is not None:
        messages.append(result.path.to_message(stamp_ns))
    with McapRecorder(recording, metadata={"mapfuse": {"written_by": library()}}) as recorder:
        for message in messages:
            recorder.put(message)
        error = recorder.close().error
    if error is not None:
        raise ToolError(error)
