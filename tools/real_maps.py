"""Maps and logs of public data sets that are no map_server files."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.carmen_lines import beam_angles
from drivers.wording import fault_in
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.metrics import align_points
from mapping.sensor_models import log_odds
from tools.errors import ToolError
from tools.log_windows import PosedScans

FloatArray = NDArray[np.float64]
LOG_REACH_M = {"belgioioso": 15.0, "csail": 15.0, "edmonton": 25.0, "fhw": 15.0, "freiburg-101": 15.0}
HALMSTAD_M_PER_PX = {"F5": 0.04, "HIH": 0.02, "KPT4A": 0.02}  # nominal: the data set states none
_SURE = log_odds(0.99)
_SHORTEST_M, _NO_RETURN_M = 0.05, 79.0
_GATE_PX = 60.0
_LEAST_POINTS = 5


def read_corrected_log(path: Path, reach_m: float) -> PosedScans:
    """Read the FLASER lines of a CARMEN log, gzipped or not: readings, then the corrected pose; raises ToolError."""
    building = path.name.split(".", maxsplit=1)[0].removesuffix("-corrected")
    opener = gzip.open if path.suffix == ".gz" else open
    poses, points, stamps_s = [], [], []
    try:
        with opener(path, "rt", encoding="ascii", errors="replace") as lines:
            for line in lines:
                fields = line.split()
                if not fields or fields[0] != "FLASER":
                    continue
                count = int(fields[1])
                values = np.array(fields[2 : count + 5], dtype=np.float64)
                if len(values) != count + 3:
                    raise ValueError(f"{len(values)} numbers for {count} readings and a pose")
                ranges, angles = values[:count], beam_angles(count)
                valid = (ranges >= _SHORTEST_M) & (ranges < _NO_RETURN_M)
                poses.append(values[count:])
                stamps_s.append(float(fields[-1]))
                points.append((ranges * np.array([np.cos(angles), np.sin(angles)])).T[valid])
    except (OSError, EOFError, ValueError, IndexError) as error:
        raise ToolError(f"{path}: not a corrected CARMEN log: {fault_in(error)}") from error
    if not poses:
        raise ToolError(f"{path}: no FLASER line in it: give a CARMEN log with corrected poses")
    stamps_ns = np.round(np.array(stamps_s) * 1e9).astype(np.int64)
    rising = bool((np.diff(stamps_ns) > 0).all())
    duration_s = _duration_s(stamps_s)
    return PosedScans(
        building, np.array(poses), tuple(points), reach_m, duration_s, stamps_ns=stamps_ns if rising else None
    )


def _duration_s(stamps_s: list[float]) -> float | None:
    """Return the time of a drive; None for stamps rounded so much that most of them are equal, as in csail."""
    told = len(set(stamps_s)) > len(stamps_s) // 2 and max(stamps_s) > min(stamps_s)
    return max(stamps_s) - min(stamps_s) if told else None


def read_text_grid(path: Path, resolution_m: float) -> OccupancyGrid:
    """Read a table of 0 occupied, 255 free, others unknown, top row first; y up from its lower edge. ToolError."""
    try:
        cells = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise ToolError(f"{path}: not a table of numbers: {fault_in(error)}") from error
    upright = np.flipud(cells)
    log_odds_of = np.select([upright == 0, upright == 255], [_SURE, -_SURE], 0.0)
    return OccupancyGrid(log_odds_of.astype(np.float32), resolution_m, np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """Points (N, 2) in m that people marked in two maps, the rigid fit T_a_b (3,) and its rms residual in m."""

    points_a: FloatArray
    points_b: FloatArray
    T_a_b: FloatArray
    residual_m: float


def halmstad_points(folder: Path, a: str, b: str) -> Correspondence:
    """Return the annotated points that two maps of the Halmstad set share; raises ToolError."""
    resolution_m = HALMSTAD_M_PER_PX[a.split("_", maxsplit=1)[0]]
    points_a, points_b, _ = _shared_points(folder, a, b)
    return rigid_fit(points_a * resolution_m, points_b * resolution_m, _GATE_PX * resolution_m)


def halmstad_plan(folder: Path, maps: Sequence[str]) -> tuple[float, list[Correspondence]]:
    """Return metres a pixel of a building's layout, and where each of its maps fits into it; raises ToolError.

    A layout's scale is no map's: it is the mean of the similarities that the set states of its maps, so that they are
    of the right size on the whole. points_a are those of the layout, from its lower-left corner.
    """
    building = maps[0].split("_", maxsplit=1)[0]
    resolution_m = HALMSTAD_M_PER_PX[building]
    shared = [_shared_points(folder, name, f"{building}_layout") for name in maps]
    plan_m = resolution_m / float(np.mean([scale for _, _, scale in shared]))
    gate_m = _GATE_PX * resolution_m
    return plan_m, [rigid_fit(on_plan * plan_m, in_map * resolution_m, gate_m) for in_map, on_plan, _ in shared]


def _shared_points(folder: Path, a: str, b: str) -> tuple[FloatArray, FloatArray, float]:
    """Return points (N, 2), (N, 2) in pixels, y up, that people marked in both images, and the scale from a to b.

    The set's own associations are pickled. Instead points are paired that a similarity, fitted to those associations
    and stored as text, brings within 60 px of each other, both being the other's nearest.
    """
    try:
        lines = (folder / "gt_alignments_dev.csv").read_text(encoding="utf-8").splitlines()
        row = next(line.split(",") for line in lines if line.startswith(f"{a},{b},"))
        points_a, points_b = (np.load(folder / f"annotations/keypoints_{name}.npy") for name in (a, b))
    except (OSError, ValueError, StopIteration) as error:
        raise ToolError(f"{folder}: no annotation of {a} and {b}: {fault_in(error)}") from error
    scale, turn = float(row[3]), np.radians(float(row[4]))
    moved = se2.transform_points(np.array([float(row[5]), float(row[6]), turn]), points_a * scale)
    apart = np.hypot(*(moved[:, np.newaxis] - points_b[np.newaxis]).transpose(2, 0, 1))
    nearest = apart.argmin(axis=1)
    mutual = (apart[:, nearest].argmin(axis=0) == np.arange(len(points_a))) & (apart.min(axis=1) < _GATE_PX)
    if np.count_nonzero(mutual) < _LEAST_POINTS:
        raise ToolError(
            f"{folder}: {a} and {b} share {np.count_nonzero(mutual)} annotated points, {_LEAST_POINTS} are needed"
        )
    return points_a[mutual], points_b[nearest[mutual]], scale


def rigid_fit(points_a: FloatArray, points_b: FloatArray, gate_m: float) -> Correspondence:
    """Return the rigid motion of associated points (N, 2), some of them mislabelled, and the points within the gate.

    Fitted on every two points; the fit with the least median distance is kept, and fitted again on all points that it
    brings within the gate.
    """
    first, second = np.triu_indices(len(points_a), 1)
    turns = [np.arctan2(*(points[second] - points[first]).T[::-1]) for points in (points_a, points_b)]
    yaw = turns[0] - turns[1]
    middle_a, middle_b = ((points[first] + points[second]) / 2.0 for points in (points_a, points_b))
    turned = se2.transform_points(np.column_stack([np.zeros((len(yaw), 2)), yaw]), middle_b)
    fits = np.column_stack([middle_a - turned, yaw])
    apart = [np.hypot(*(se2.transform_points(fit, points_b) - points_a).T) for fit in fits]
    best = int(np.argmin(np.median(apart, axis=1)))
    kept = apart[best] < gate_m
    in_a, in_b = points_a[kept], points_b[kept]
    T_a_b = align_points(in_a, in_b)
    residual = np.sqrt(((se2.transform_points(T_a_b, in_b) - in_a) ** 2).sum(axis=1).mean())
    return Correspondence(in_a, in_b, T_a_b, float(residual))
