"""`evaluate plans`: how many of a set of problems a planner solves, and whether a second opinion finds a collision."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.wording import fault_in
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from planning.plan import PlanSettings
from planning.vehicle import Vehicle
from tools.errors import ToolError
from tools.path_planning import timed_plan
from tools.results import Report

FloatArray = NDArray[np.float64]
_FINE_M, _BODY_M = 0.005, 0.01  # between poses, and between points of the body
_POSES_AT_ONCE = 500


def evaluate_plans(
    problems_file: Path, vehicle: Vehicle, settings: PlanSettings, seed: int, on_progress: Callable[[str], None]
) -> Report:
    """Plan each problem of a file {map: [{start, goal, ref}, ...]} on <map>.yaml beside it.

    ref is a length in m that a path is compared with. Raises ToolError and MapFileError.
    """
    try:
        problems = json.loads(problems_file.read_text(encoding="utf-8"))
        cases = [
            (name, _finite(p["start"], 3), _finite(p["goal"], 3), float(_finite([p["ref"]], 1)[0]))
            for name, listed in problems.items()
            for p in listed
        ]
        if not problems or not all(problems.values()):
            raise ValueError("a map without problems, or no map")
        files = {name: problems_file.with_name(f"{name}.yaml") for name in problems}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ToolError(
            f"{problems_file}: not a file of planning problems ({fault_in(error)}): expected "
            "{map: [{start: [x, y, yaw], goal: [x, y, yaw], ref: m}, ...]}"
        ) from error
    grids = {name: read_map(file) for name, file in files.items()}
    for grid in grids.values():  # compile before the clock runs
        timed_plan(grid, np.zeros(3), np.zeros(3), vehicle, settings, seed)
    rows = []
    for number, (name, start, goal, ref_m) in enumerate(cases):
        result, seconds = timed_plan(grids[name], start, goal, vehicle, settings, seed)
        row: Report = {"map": name, "problem": number, "solved": result.path is not None, "seconds": round(seconds, 4)}
        row["error"] = result.error.nav2_name if result.error else None
        row["reason"] = result.reason
        if result.path is not None:
            row["length_over_ref"] = round(result.path.length_m / ref_m, 4)
            row["colliding_poses"] = colliding_poses(grids[name], result.path.poses, vehicle)
        rows.append(row)
        on_progress(f"{name} {number}: {'solved' if row['solved'] else row['error']} in {seconds:.2f} s")
    return {"planner": settings.planner.value, "maps": {name: _summary(rows, name) for name in problems}, "rows": rows}


def _finite(values: object, count: int) -> FloatArray:
    """Return so many numbers; raises ValueError and TypeError for anything else."""
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"{values} where {count} finite number{'s' if count > 1 else ''} should be")
    return numbers


def colliding_poses(grid: OccupancyGrid, poses: FloatArray, vehicle: Vehicle) -> int:
    """Count poses along a path (N, 3), refined to 5 mm, at which a point of the car's body lies in an occupied cell.

    Written apart from the planner's own test on purpose: it looks up points of the body every centimetre, edges too.
    """
    body = _points_inside(vehicle.body)
    rows, cols = grid.log_odds.shape
    occupied, count = grid.occupied, 0
    fine = _refined(poses)
    for first in range(0, len(fine), _POSES_AT_ONCE):
        part = fine[first : first + _POSES_AT_ONCE]
        points = se2.transform_points(part[:, np.newaxis, :], body[np.newaxis])
        cells = np.floor(grid.cell_coordinates(points.reshape(-1, 2))).astype(np.int64)
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < cols) & (cells[:, 1] < rows)
        hit = ~inside
        hit[inside] = occupied[cells[inside, 1], cells[inside, 0]]
        count += int(np.count_nonzero(hit.reshape(len(part), -1).any(axis=1)))
    return count


def _points_inside(outline: FloatArray) -> FloatArray:
    """Return points (M, 2) a centimetre apart inside a convex outline (K, 2), and along its sides."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    axes = [np.linspace(low[i], high[i], 1 + int(np.ceil((high[i] - low[i]) / _BODY_M))) for i in (0, 1)]
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    sides = np.roll(outline, -1, axis=0) - outline
    from_corners = lattice[:, np.newaxis] - outline
    inside = (sides[:, 0] * from_corners[..., 1] - sides[:, 1] * from_corners[..., 0] >= -1e-9).all(axis=1)
    along = [
        corner + np.linspace(0.0, 1.0, 1 + int(np.ceil(np.hypot(*side) / _BODY_M)))[:, np.newaxis] * side
        for corner, side in zip(outline, sides, strict=True)
    ]
    return np.vstack([lattice[inside], *along])


def _refined(poses: FloatArray) -> FloatArray:
    """Put poses in between, on straight lines, so that neighbours are no more than 5 mm apart."""
    steps = np.diff(poses, axis=0)
    steps[:, 2] = se2.wrap_angle(steps[:, 2])
    parts = max(1, int(np.ceil(np.hypot(steps[:, 0], steps[:, 1]).max(initial=0.0) / _FINE_M)))
    shares = np.arange(parts) / parts
    between = (poses[:-1, np.newaxis] + shares[:, np.newaxis] * steps[:, np.newaxis]).reshape(-1, 3)
    return np.vstack([between, poses[-1:]])


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
