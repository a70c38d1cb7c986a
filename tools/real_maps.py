"""Maps and logs of public data sets that are no map_server files, read as grids."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.carmen_lines import RANGE_MAX_M, beam_angles
from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.metrics import align_points
from mapping.sensor_models import LidarModel, log_odds
from tools.errors import ToolError

FloatArray = NDArray[np.float64]
_SURE = log_odds(0.99)
_SHORTEST_M = 0.05
_GATE_PX = 60.0
HALMSTAD_M_PER_PX = {"F5": 0.04, "HIH": 0.02, "KPT4A": 0.02}  # nominal: the data set states none


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedLog:
    """A laser log with the poses of a SLAM result: poses (N, 3), ranges (N, beams) in m, travelled (N,) in m."""

    poses: FloatArray
    ranges_m: FloatArray
    travelled_m: FloatArray


def read_corrected_log(path: Path) -> CorrectedLog:
    """Read the FLASER lines of a gzipped CARMEN log: readings, then the corrected pose; raises ToolError."""
    rows = []
    try:
        with gzip.open(path, "rt", encoding="ascii", errors="replace") as lines:
            for line in lines:
                fields = line.split()
                if fields and fields[0] == "FLASER":
                    rows.append([float(field) for field in fields[2 : int(fields[1]) + 5]])
        values = np.array(rows, dtype=np.float64)
        poses, ranges = values[:, -3:], values[:, :-3]
    except (OSError, EOFError, ValueError, IndexError) as error:
        raise ToolError(f"{path}: not a corrected CARMEN log: {error}") from error
    steps = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T)
    return CorrectedLog(poses, ranges, np.cumsum(steps))


def map_of(
    log: CorrectedLog, scans: NDArray[np.intp], resolution_m: float, max_range_m: float, T_map_log: FloatArray
) -> OccupancyGrid:
    """Return the grid of some scans, drawn in a frame in which the log's frame has the pose T_map_log (3,)."""
    builder = GridBuilder(resolution_m, LidarModel(max_range_m=max_range_m))
    angles = beam_angles(log.ranges_m.shape[1])
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    for number in scans:
        ranges = log.ranges_m[number]
        valid = (ranges > _SHORTEST_M) & (ranges < RANGE_MAX_M - 1.0)
        pose = se2.compose(T_map_log, log.poses[number])
        builder.add_scan(pose[:2], se2.transform_points(pose, directions[valid] * ranges[valid, np.newaxis]))
    return builder.grid()


def read_picture_map(path: Path, resolution_m: float) -> OccupancyGrid:
    """Read a picture of 0 occupied, 255 free, others unknown, without YAML; y up from its lower edge. ToolError."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ToolError(f"{path}: not a readable picture: check the data folder")
    upright = np.flipud(image)
    cells = np.select([upright == 0, upright == 255], [_SURE, -_SURE], 0.0)
    return OccupancyGrid(cells.astype(np.float32), resolution_m, np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Correspondence:
    """Points (N, 2) in m that people marked in two maps, the rigid fit T_a_b (3,) and its rms residual in m."""

    points_a: FloatArray
    points_b: FloatArray
    T_a_b: FloatArray
    residual_m: float


def halmstad_points(folder: Path, a: str, b: str) -> Correspondence:
    """Return the annotated points that two maps of the Halmstad set share; raises ToolError.

    The set's own associations are pickled. Instead points are paired that a similarity, fitted to those associations
    and stored as text, brings within 60 px of each other, both being the other's nearest.
    """
    resolution_m = HALMSTAD_M_PER_PX[a.split("_", maxsplit=1)[0]]
    try:
        lines = (folder / "gt_alignments_dev.csv").read_text(encoding="utf-8").splitlines()
        row = next(line.split(",") for line in lines if line.startswith(f"{a},{b},"))
        points_a, points_b = (np.load(folder / f"annotations/keypoints_{name}.npy") for name in (a, b))
    except (OSError, ValueError, StopIteration) as error:
        raise ToolError(f"{folder}: no annotation of {a} and {b}: {error!r}") from error
    scale, turn = float(row[3]), np.radians(float(row[4]))
    moved = se2.transform_points(np.array([float(row[5]), float(row[6]), turn]), points_a * scale)
    apart = np.hypot(*(moved[:, np.newaxis] - points_b[np.newaxis]).transpose(2, 0, 1))
    nearest = apart.argmin(axis=1)
    mutual = (apart[:, nearest].argmin(axis=0) == np.arange(len(points_a))) & (apart.min(axis=1) < _GATE_PX)
    in_a, in_b = points_a[mutual] * resolution_m, points_b[nearest[mutual]] * resolution_m
    if len(in_a) < 5:
        raise ToolError(f"{folder}: {a} and {b} share {len(in_a)} annotated points, 5 are needed")
    T_a_b = align_points(in_a, in_b)
    residual = np.sqrt(((se2.transform_points(T_a_b, in_b) - in_a) ** 2).sum(axis=1).mean())
    return Correspondence(in_a, in_b, T_a_b, float(residual))
