"""`align` and `fuse`: map files in, the relative pose or the global map out."""

from __future__ import annotations

import json
import logging
import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.alignment import Alignment
from fusion.certainty import fuse_pair
from fusion.identity import reference_rank, same_evidence
from fusion.registration import Method, register
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map_with_warnings, write_map
from tools.errors import UsageError
from tools.pictures import draw_map, write_picture
from tools.results import FloatArray, Report, check_run_folder, new_run_folder, writing_to

log = logging.getLogger(__name__)
_MOST_MAPS = 2
_GLOBAL_FILE = re.compile(r"global_(\d+)\.(yaml|pgm|npz|png)")


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """One global map and, for each file in it, its number in the arguments and the pose of its frame (3,)."""

    grid: OccupancyGrid
    T_global_map: dict[int, FloatArray]


def align_maps(a: Path, b: Path, *, preset: Method, seed: int) -> Report:
    """Register two map files; (dx, dy, theta_deg) is the pose of b's map frame in a's. Raises MapFileError."""
    grids = [_load(path) for path in (a, b)]
    alignment, seconds = _timed_register(grids[0], grids[1], preset, seed)
    return {
        "accepted": alignment.accepted,
        "probability": None,
        **_pose_fields(alignment.T_a_b),
        "covariance": None,
        "acceptance": round(alignment.acceptance, 4),
        "inliers": alignment.inliers,
        "overlap": round(alignment.overlap, 4),
        "reason": alignment.reason,
        "alternatives": [],
        "seconds": round(seconds, 3),
    }


def fuse_maps(files: Sequence[Path], output: Path | None, *, preset: Method, seed: int) -> tuple[Path, Report]:
    """Fuse one or two map files into a folder, global_<k>.yaml/.pgm/.npz/.png and report.json; return both.

    Maps that do not belong together become a global map each; a map without a known cell is skipped. The order of the
    files changes nothing but the order in the report. Raises MapFileError, ToolError and UsageError.
    """
    if len(files) > _MOST_MAPS:
        raise UsageError(f"{len(files)} maps given: this release fuses two at a time; fuse the result with the next")
    check_run_folder(output)
    grids = [_load(path) for path in files]
    usable = [number for number, grid in enumerate(grids) if grid.known.any()]
    for number in sorted(set(range(len(files))) - set(usable)):
        log.warning("%s: no known cell: skipped", files[number])
    groups, pairs = _grouped(files, grids, usable, preset, seed)
    report: Report = {
        "maps": [_map_entry(str(path), number, groups) for number, path in enumerate(files)],
        "pairs": pairs,
        "preset": preset,
        "seed": seed,
    }
    folder = new_run_folder(output)
    _save(folder, groups, report)
    return folder, report


def _load(path: Path) -> OccupancyGrid:
    loaded = read_map_with_warnings(path)
    for warning in loaded.warnings:
        log.warning("%s", warning)
    return loaded.grid


def _timed_register(a: OccupancyGrid, b: OccupancyGrid, preset: Method, seed: int) -> tuple[Alignment, float]:
    started = time.perf_counter()
    alignment = register(a, b, preset, seed)
    return alignment, time.perf_counter() - started


def _grouped(
    files: Sequence[Path], grids: Sequence[OccupancyGrid], usable: Sequence[int], preset: Method, seed: int
) -> tuple[list[_Group], list[Report]]:
    """Return the groups, the one with the best reference first, and the report on each pair."""
    alone = [_Group(grids[number], {number: se2.IDENTITY}) for number in usable]
    alone.sort(key=lambda group: reference_rank(group.grid))
    if len(usable) < _MOST_MAPS:
        return alone, []
    a, b = grids
    alignment, seconds = _timed_register(a, b, preset, seed)
    pair: Report = {
        "a": str(files[0]),
        "b": str(files[1]),
        "accepted": alignment.accepted,
        "probability": None,
        **_pose_fields(alignment.T_a_b),
        "reason": alignment.reason,
        "same_evidence": same_evidence(a, b),
        "seconds": round(seconds, 3),
    }
    if not alignment.accepted or alignment.T_a_b is None:
        return alone, [pair]
    fused = fuse_pair(a, b, alignment.T_a_b)
    return [_Group(fused.grid, {0: fused.T_global_a, 1: fused.T_global_b})], [pair]


def _pose_fields(pose: FloatArray | None) -> Report:
    if pose is None:
        return {"dx": None, "dy": None, "theta_deg": None}
    x, y, yaw = np.asarray(pose).tolist()
    return {"dx": x, "dy": y, "theta_deg": math.degrees(yaw)}


def _map_entry(file: str, number: int, groups: Sequence[_Group]) -> Report:
    for k, group in enumerate(groups):
        if number in group.T_global_map:
            return {"file": file, "group": k, "T_global_map": group.T_global_map[number].tolist()}
    return {"file": file, "group": None, "T_global_map": None}


def _save(folder: Path, groups: Sequence[_Group], report: Report) -> None:
    """Write the global maps, and take away those of an earlier, larger result."""
    with writing_to(folder):
        for path in folder.iterdir():
            match = _GLOBAL_FILE.fullmatch(path.name)
            if match and int(match.group(1)) >= len(groups):
                path.unlink()
        for k, group in enumerate(groups):
            sources = [entry["file"] for entry in report["maps"] if entry["group"] == k]
            write_map(folder / f"global_{k}", group.grid, provenance={"source": " + ".join(sorted(sources))})
            write_picture(folder / f"global_{k}.png", draw_map(group.grid))
        partial = folder / "report.json.part"
        partial.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        partial.replace(folder / "report.json")
