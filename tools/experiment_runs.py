"""Table 5.1: two maps merged many times with other seeds: acceptance index, time, inliers, pose, and error."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.algorithm3 import register_with_seeds
from fusion.alignment import Alignment
from fusion.evaluation import alignment_error
from fusion.registration import register, warm_up
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.experiment import Experiment, ExperimentSettings, Table
from tools.finished_rows import FinishedRows, finish_rows
from tools.map_data_set import DataSetMap, MapDataSet, data_hash
from tools.merging_methods import METHODS
from tools.pair_files import RIGHT_DEG, RIGHT_M
from tools.pair_registration import Registration
from tools.results import FloatArray, Report

_TIMED = 5
# The thesis's own: omega, seconds, inliers, deviation of rotation (deg) and of translation (m).
_THESIS_ROWS = (
    (25, 25, "0.98 ± 0.0002", "0.49 ± 0.008", "33", "0.0472", "0.9274"),
    (20, 20, "0.97 ± 0.0005", "0.32 ± 0.005", "35", "0.0935", "1.4873"),
    (10, 10, "0.95 ± 0.002", "0.10 ± 0.002", "9", "1.1e-07", "3.06e-05"),
    (25, 20, "0.97 ± 0.0008", "0.48 ± 0.011", "28", "0.1046", "1.5863"),
    (25, 10, "0.93 ± 0.001", "0.47 ± 0.007", "25", "0.2161", "1.6717"),
    (20, 10, "0.94 ± 0.003", "0.31 ± 0.006", "22", "0.2535", "1.9222"),
)  # fmt: skip
_PER_RUN = ("acceptance", "inliers", "error_m", "error_deg")
_COLUMNS = (
    "r_a", "r_b", "accepted", "and right", "omega", "s a run", "CPU s", "inliers", "rotation, deg", "translation, m",
    "error, m", "error, deg",
)  # fmt: skip
_NOTE = (
    "Accepted of all runs, and of these right: within {m:g} m (rms over the common free space) and {deg:g} deg of the "
    "truth. Mean ± deviation over the runs that found a pose, accepted or not; translation: x, y of b's frame in a's, "
    "± the rms distance from that. Error against the truth, which the thesis lacks: median, worst. Seconds: wall "
    "clock and processor, in one thread, of {timed} whole runs; in the others features, which hang on no "
    "seed, were not made again."
)


def lacks(data: MapDataSet) -> str | None:
    """Return what a set lacks: two parts at the same resolutions, with their true poses."""
    if len(paired(data)) < 1:
        return "no two overlapping parts with true poses at common resolutions: make a set of the kind parts"
    return None


def paired(data: MapDataSet) -> list[tuple[DataSetMap, DataSetMap]]:
    """Return the pairs of table 5.1: a's map at each resolution with b's at the same, then with each coarser one."""
    if data.kind != "parts":
        return []
    robots = sorted({each.robot for each in data.maps})
    if len(robots) != 2 or any(each.pose is None for each in data.maps):
        return []
    by_part = [
        {each.cells_per_meter: each for each in sorted(data.maps, key=lambda m: m.resolution_m) if each.robot == robot}
        for robot in robots
    ]
    common = [r for r in by_part[0] if any(math.isclose(r, other) for other in by_part[1])]
    chosen = [(r, r) for r in common] + list(itertools.combinations(common, 2))
    return [(by_part[0][a], _nearest(by_part[1], b)) for a, b in chosen]


def true_pose(a: DataSetMap, b: DataSetMap) -> FloatArray:
    """Return the true pose (3,) of b's frame in a's."""
    assert a.pose is not None
    assert b.pose is not None, "lacks() asks for true poses"
    return se2.between(a.pose, b.pose)


def run(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Merge each pair by each method so many times."""
    tasks: dict[str, Sequence[Any]] = {}
    for (name, method), (a, b) in itertools.product(METHODS.items(), paired(data)):
        runs = min(settings.runs, method.most_runs)
        arguments = (a.path, b.path, true_pose(a, b), replace(method.registration, seed=settings.seed), runs)
        tasks[f"{name} {a.name} {b.name}"] = arguments
    rows = FinishedRows(folder / "rows.jsonl", _identity(data, settings))
    found = finish_rows(rows, merge_runs, tasks, settings.jobs, "5.1")
    tables, figures = list[Table](), list[Report]()
    for name, method in METHODS.items():
        lines = []
        for a, b in paired(data):
            row = found[f"{name} {a.name} {b.name}"]
            summary = summarised(row)
            figures.append({"method": name, "r_a": a.cells_per_meter, "r_b": b.cells_per_meter, **summary, "runs": row})
            lines.append([f"{a.cells_per_meter:g}", f"{b.cells_per_meter:g}", *_texts(summary)])
        runs = min(settings.runs, method.most_runs)
        note = _NOTE.format(m=RIGHT_M, deg=RIGHT_DEG, timed=min(_TIMED, runs))
        tables.append(Table(f"{method.title}: {runs} runs", _COLUMNS, lines, note if not tables else ""))
    tables.append(_thesis_table())
    settings_of = {name: method.registration.settings_report() for name, method in METHODS.items()}
    return Experiment(tables, (), json.loads(json.dumps({"rows": figures, "methods": settings_of}, default=str)))


def merge_runs(a_path: Path, b_path: Path, T_a_b: FloatArray, registration: Registration, runs: int) -> Report:
    """Merge two maps with that many seeds; lists of what each run found, and of how long whole runs took."""
    a, b = read_map(a_path), read_map(b_path)
    warm_up(registration.method)
    seeds = [registration.seed + number for number in range(runs)]
    seconds, cpu_seconds, found = [], [], []
    for seed in seeds[:_TIMED] if registration.method == "thesis" else seeds:
        started, cpu = time.perf_counter(), time.process_time()
        found.append(register(a, b, registration.method, seed, registration.settings))
        seconds.append(time.perf_counter() - started)
        cpu_seconds.append(time.process_time() - cpu)
    found += register_with_seeds(a, b, registration.settings, seeds[len(found) :]) if len(found) < runs else []
    return {
        "accepted": [each.accepted for each in found],
        "acceptance": [each.acceptance for each in found],
        "inliers": [each.inliers for each in found],
        "T_a_b": [None if each.T_a_b is None else each.T_a_b.tolist() for each in found],
        **_errors(a, b, T_a_b, found),
        "seconds": seconds[:_TIMED],
        "cpu_seconds": cpu_seconds[:_TIMED],
        "reasons": sorted({each.reason for each in found if not each.accepted})[:3],
    }


def summarised(row: Report) -> Report:
    """Return counts, means and deviations of the runs of one pair."""
    poses = [pose for pose in row["T_a_b"] if pose is not None]
    has = [pose is not None for pose in row["T_a_b"]]
    right = [
        error is not None and error <= RIGHT_M and turn <= RIGHT_DEG
        for error, turn in zip(row["error_m"], row["error_deg"], strict=True)
    ]
    accepted = row["accepted"]
    summary: Report = {
        "accepted": sum(accepted),
        "accepted_right": sum(a and r for a, r in zip(accepted, right, strict=True)),
        "right": sum(right),
        "found": len(poses),
        "count": len(accepted),
        "seconds": _mean_deviation(row["seconds"]),
        "cpu_seconds": _mean_deviation(row["cpu_seconds"]),
    }
    if not poses:
        return summary
    T = np.array(poses)
    yaw_deg, turn_deg = _mean_angle_deg(T[:, 2])
    middle = T[:, :2].mean(axis=0)
    kept = {key: [value for value, there in zip(row[key], has, strict=True) if there] for key in _PER_RUN}
    return summary | {
        "acceptance": _mean_deviation(kept["acceptance"]),
        "inliers": None if kept["inliers"][0] is None else _mean_deviation(kept["inliers"]),
        "rotation_deg": [yaw_deg, turn_deg],
        "translation_m": [*middle.tolist(), float(np.sqrt(((T[:, :2] - middle) ** 2).sum(axis=1).mean()))],
        "error_m": [float(np.median(kept["error_m"])), max(kept["error_m"])],
        "error_deg": [float(np.median(kept["error_deg"])), max(kept["error_deg"])],
    }


def _errors(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray, found: Sequence[Alignment]) -> Report:
    """Return the errors of each run; None without a pose."""
    errors = [None if each.T_a_b is None else alignment_error(a, b, each.T_a_b, T_a_b) for each in found]
    return {
        "error_m": [None if error is None else error.rms_m for error in errors],
        "error_deg": [None if error is None else error.rotation_deg for error in errors],
    }


def _texts(summary: Report) -> list[str]:
    counts = [f"{summary['accepted']} of {summary['count']}", f"{summary['accepted_right']}"]
    seconds, cpu = ("{:.2f} ± {:.2f}".format(*summary[key]) for key in ("seconds", "cpu_seconds"))
    if not summary["found"]:
        return [*counts, "no pose", seconds, cpu, *["-"] * 5]
    inliers = "-" if summary["inliers"] is None else "{:.1f} ± {:.1f}".format(*summary["inliers"])
    return [
        *counts,
        "{:.3f} ± {:.4f}".format(*summary["acceptance"]),
        seconds,
        cpu,
        inliers,
        "{:.3f} ± {:.4f}".format(*summary["rotation_deg"]),
        "{:.3f}, {:.3f} ± {:.4f}".format(*summary["translation_m"]),
        "{:.3f}, {:.3f}".format(*summary["error_m"]),
        "{:.3f}, {:.3f}".format(*summary["error_deg"]),
    ]


def _thesis_table() -> Table:
    columns = ("r_a", "r_b", "omega", "s a run", "inliers", "rotation ±, deg", "translation ±, m")
    rows = [[str(each) for each in row] for row in _THESIS_ROWS]
    note = "Of two maps of its own, which are not published, by MATLAB at 3.6 GHz: not comparable number by number."
    return Table("What the thesis prints, of OTHER data: 100 runs", columns, rows, note)


def _mean_deviation(values: Sequence[float]) -> list[float]:
    return [float(np.mean(values)), float(np.std(values))]


def _mean_angle_deg(yaw_rad: FloatArray) -> tuple[float, float]:
    """Return the mean of angles, and the deviation from it, in degrees."""
    mean = math.atan2(float(np.sin(yaw_rad).mean()), float(np.cos(yaw_rad).mean()))
    off = se2.wrap_angle(yaw_rad - mean)
    return math.degrees(mean), math.degrees(float(np.sqrt((off**2).mean())))


def _nearest(maps: dict[float, DataSetMap], r: float) -> DataSetMap:
    return maps[min(maps, key=lambda each: abs(each - r))]


def _identity(data: MapDataSet, settings: ExperimentSettings) -> str:
    """Return what finished rows depend on beside maps and method."""
    labels = [method.registration.label() for method in METHODS.values()]
    return json.dumps([data_hash(data), settings.runs, settings.seed, labels])
