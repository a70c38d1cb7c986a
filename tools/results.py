"""What a run or a replay leaves in its folder: map, trajectory, picture and report."""

from __future__ import annotations

import errno
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.messages import GridSnapshot
from drivers.rplidar_decoder import DecoderCounters
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.slam_state import STATE_NAME, write_state
from mapping.trajectory import Trajectory, write_tum
from tools.errors import ToolError
from tools.pictures import draw_map, draw_pose_graph, write_picture
from tools.pipeline import MappingFlow

FloatArray = NDArray[np.float64]
Report = dict[str, Any]  # a JSON object

_MOST_LOST_LINES = 6


def new_run_folder(chosen: Path | None) -> Path:
    """Create and return the folder for results: the chosen one, or a new runs/<local time>; raises ToolError."""
    with writing_to(chosen or Path("runs")):
        if chosen is not None:
            chosen.mkdir(parents=True, exist_ok=True)
            return chosen
        now = datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
        for suffix in itertools.chain([""], (f"_{number}" for number in itertools.count(2))):
            folder = Path("runs") / f"{now}{suffix}"
            with suppress(FileExistsError):  # another command began in the same second
                folder.mkdir(parents=True)
                return folder
    raise AssertionError("unreachable: one of the names is free")


def check_run_folder(chosen: Path | None) -> None:
    """Raise the ToolError of `new_run_folder` before the work is done, where it can be foreseen; create nothing."""
    folder = (chosen or Path("runs")).absolute()
    with writing_to(folder):
        existing = next(path for path in (folder, *folder.parents) if path.exists())
        if not existing.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{existing} is not a folder")
        if not os.access(existing, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids):
            raise PermissionError(errno.EACCES, f"{existing} is not writable")


def check_new_file(path: Path) -> None:
    """Raise ToolError where a file cannot be written: it is tried, and nothing is left of it or changed."""
    with writing_to(path):
        if not path.absolute().parent.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{path.parent} is no folder")
        if path.exists():
            path.open("ab").close()
        else:
            path.open("xb").close()
            path.unlink()


@contextmanager
def writing_to(place: Path) -> Iterator[None]:
    """Turn a failure to write to a folder or file into a ToolError of one line."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{place}: cannot write results: {error.strerror or error}: name another place") from error


def save_results(
    folder: Path, flow: MappingFlow, source: str, details: Mapping[str, object], *, save_state: bool = False
) -> Report:
    """Write map.yaml/.pgm/.npz/.png, pose_graph.png, trajectory.tum and report.json; return the report.

    With a lidar and a camera also depth_map.* and both_map.*. save_state: also slam_state.npz, from which another run
    can go on. Raises ToolError.
    """
    maps, trajectory = flow.maps(), flow.mapper.trajectory
    span_s = float(np.ptp(trajectory.stamps_ns)) * 1e-9 if len(trajectory) else 0.0
    counters = asdict(flow.mapper.counters)
    report: Report = {
        "source": source,
        "scans": {"received": flow.scans, **counters, "in_map": _placed_here(flow, trajectory)},
        "trajectory": {
            "poses": len(trajectory),
            "duration_s": round(span_s, 3),
            "length_m": round(trajectory.length_m, 3),
            "end": _pose_summary(trajectory.poses[-1]) if len(trajectory) else None,
        },
        **{name: _map_summary(grid) for name, grid in maps.items()},
        "slam": _slam_summary(flow),
        "timing": _timing(flow.seconds, span_s),
        **details,
    }
    with writing_to(folder):
        for name, grid in maps.items():
            write_map(folder / name, grid, provenance={"source": source})
            write_picture(folder / f"{name}.png", draw_map(grid, trajectory))
        write_tum(folder / "trajectory.tum", trajectory)
        write_picture(folder / "pose_graph.png", draw_pose_graph(maps["map"], flow.mapper.graph.pose_graph()))
        if save_state and len(flow.mapper.graph.keyframe_poses):
            write_state(folder / STATE_NAME, flow.mapper.graph.state())
        partial = folder / "report.json.part"
        partial.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        partial.replace(folder / "report.json")
    return report


def remarks(report: Report) -> list[str]:
    """Return the lines that the end of a run owes its reader: what is not in the map, and a map that shows nothing."""
    lines = lost_pieces(report)
    if not report["map"]["occupied_cells"]:
        place = "its place (depth.mount) and height band (depth.bottom_m, top_m)" if "depth" in report else "its place"
        lines.append(f"the map shows no wall at all: nothing was in reach of the sensor, or {place} is not what is set")
    return lines


def _placed_here(flow: MappingFlow, trajectory: Trajectory) -> int:
    """Return how many scans of this drive have a pose in the map; of what was matched, lost pieces have none."""
    before_ns = flow.mapper.resumed_ns
    return len(trajectory) if before_ns is None else int((trajectory.stamps_ns > before_ns).sum())


def lost_pieces(report: Report) -> list[str]:
    """Return a line for each piece of the drive that tracking lost and no loop closure could place in the map.

    Of many the longest have a line each, and one says how much the others are.
    """
    lost = [(number, piece) for number, piece in enumerate(report["slam"]["segments"]) if not piece["in_map"]]
    by_length = sorted(lost, key=lambda each: -each[1]["scans"])
    lines = []
    for number, piece in sorted(by_length[:_MOST_LOST_LINES], key=lambda each: each[0]):
        where = "from the beginning" if number == 0 else "where tracking was lost"
        start_s = piece["start_ns"] * 1e-9
        lines.append(f"not in the map: {piece['scans']} scans in {_seconds(piece):.0f} s, {where} at {start_s:.3f}")
    others = [piece for _, piece in by_length[_MOST_LOST_LINES:]]
    if others:
        scans, total_s = sum(piece["scans"] for piece in others), sum(_seconds(piece) for piece in others)
        lines.append(
            f"not in the map: {len(others)} shorter pieces, {scans} scans in {total_s:.0f} s: report.json lists them"
        )
    return lines


def is_placed(report: Report) -> bool:
    """Whether the car was found on the map that it was to be found on, if there was one, and no piece is lost."""
    return report.get("localisation", {"found": True})["found"] and not lost_pieces(report)


def _seconds(piece: Report) -> float:
    return float(piece["end_ns"] - piece["start_ns"]) * 1e-9


def decoding_summary(streams: Sequence[DecoderCounters]) -> Report:
    """Return the sums of what the lidar's streams gave."""
    total: dict[str, int] = {}
    for counters in streams:
        for name, count in asdict(counters).items():
            total[name] = total.get(name, 0) + count
    return dict(total)


def grid_snapshot(grid: OccupancyGrid, stamp_ns: int) -> GridSnapshot:
    """Return the map as other tools read it: -1 unknown, else 0 to 100."""
    cells = np.where(grid.known, np.round(grid.probability * 100.0), -1).astype(np.int8)
    return GridSnapshot(stamp_ns, grid.resolution_m, grid.origin, cells)


def _pose_summary(pose: FloatArray) -> Report:
    x, y, yaw = pose.tolist()
    return {"x_m": round(x, 4), "y_m": round(y, 4), "yaw_deg": round(math.degrees(yaw), 2)}


def _map_summary(grid: OccupancyGrid) -> Report:
    rows, cols = grid.log_odds.shape
    return {
        "resolution_m": grid.resolution_m,
        "width_m": round(cols * grid.resolution_m, 3),
        "height_m": round(rows * grid.resolution_m, 3),
        "free_m2": round(float(grid.free.sum()) * grid.resolution_m**2, 2),
        "occupied_cells": int(grid.occupied.sum()),
    }


def _slam_summary(flow: MappingFlow) -> Report:
    """Return what loop closure and refinement did, and where tracking was lost."""
    graph = flow.mapper.graph
    return {
        "keyframes": len(graph.keyframe_poses),
        "closures": len(graph.closures),
        **asdict(graph.counters),
        "refined": flow.refined,
        "finish_s": round(flow.finish_s, 3),
        "refine_s": round(flow.refine_s, 3),
        "segments": [
            {
                "start_ns": segment.start_ns,
                "end_ns": segment.end_ns,
                "scans": segment.scans,
                "in_map": segment.in_map,
            }
            for segment in graph.segments()
        ],
    }


def _timing(seconds: Sequence[float], span_s: float) -> Report:
    """Return processing times; real_time_factor: seconds of data mapped in one second of processing."""
    if not seconds:
        return {}
    milliseconds = np.asarray(seconds) * 1e3
    return {
        "per_scan_ms_median": round(float(np.median(milliseconds)), 3),
        "per_scan_ms_p95": round(float(np.percentile(milliseconds, 95)), 3),
        "per_scan_ms_max": round(float(milliseconds.max()), 3),
        "real_time_factor": round(span_s / float(np.sum(seconds)), 1),
    }
