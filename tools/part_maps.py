"""A part of a drive as a robot's map: drawn in a frame of its own, with the trajectory in that frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.map_io import write_map
from mapping.trajectory import Trajectory, write_tum
from tools.log_windows import PosedScans, ScanNumbers, map_of
from tools.map_data_set import DataSetMap
from tools.results import writing_to

FloatArray = NDArray[np.float64]
_SHIFT_M = 1.0
_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class DrivePart:
    """What a robot drove: the numbers of its scans, every so many of the drive, the log's pose in its frame (3,)."""

    robot: str
    numbers: ScanNumbers
    scan_every: int
    T_map_log: FloatArray


def start_frame(pose: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return T_map_log (3,) of a map's frame within 1 m of where a robot started, turned by any angle."""
    shift = np.array([*random.uniform(-_SHIFT_M, _SHIFT_M, 2), random.uniform(-np.pi, np.pi)])
    return se2.inverse(se2.compose(pose, shift))


def write_part(folder: Path, scans: PosedScans, part: DrivePart, cells_per_meter: float, source: str) -> DataSetMap:
    """Write maps/<name>.yaml, .pgm, .npz and .tum below a set's folder; the set's frame is the log's.

    Raises MapFileError and ToolError.
    """
    grid = map_of(scans, part.numbers, 1.0 / cells_per_meter, part.T_map_log)
    name = f"{part.robot}-r{cells_per_meter:g}"
    provenance = {"source": source, "scan_every": str(part.scan_every), "cells_per_meter": f"{cells_per_meter:g}"}
    files = write_map(folder / "maps" / name, grid, provenance=provenance)
    track = files.lossless.with_suffix(".tum")
    with writing_to(track):
        write_tum(track, _trajectory(scans, part))
    return DataSetMap(
        name, files.lossless, grid.resolution_m, _rate_hz(scans, part), part.scan_every, part.robot,
        pose=se2.inverse(part.T_map_log), trajectory=track,
    )  # fmt: skip


def _trajectory(scans: PosedScans, part: DrivePart) -> Trajectory:
    """Return the poses of the part's scans in its map's frame; where the log has no stamps, a second a scan of it."""
    stamps_ns = part.numbers.astype(np.int64) * _SECOND_NS if scans.stamps_ns is None else scans.stamps_ns[part.numbers]
    return Trajectory(stamps_ns, se2.compose(part.T_map_log, scans.poses[part.numbers]))


def _rate_hz(scans: PosedScans, part: DrivePart) -> float | None:
    """Return T, None where stamps do not tell."""
    if scans.stamps_ns is None or len(part.numbers) < 2:
        return None
    span_s = float(np.ptp(scans.stamps_ns[part.numbers])) * 1e-9
    return (len(part.numbers) - 1) / span_s
