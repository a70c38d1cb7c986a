"""`align` and `fuse`: map files in, the relative pose or the global map out."""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from fusion.algorithm3 import Algorithm3Settings
from fusion.alignment import Alignment
from fusion.certainty import fuse_pair
from fusion.identity import reference_rank, same_evidence
from fusion.registration import Method, register, warm_up
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map_with_warnings, write_map
from tools.alignment_picture import AlignmentView, draw_alignment
from tools.errors import UsageError
from tools.pictures import draw_map, write_picture
from tools.result_folder import FUSED, check_result_folder, new_results
from tools.results import FloatArray, Report, check_run_folder, new_run_folder, writing_to

log = logging.getLogger(__name__)
_MOST_MAPS = 2


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """One global map and, for each file in it, its number in the arguments and the pose of its frame (3,)."""

    grid: OccupancyGrid
    T_global_map: dict[int, FloatArray]


@dataclass(frozen=True, slots=True)
class _Registration:
    """How maps are registered; the settings count for the method of the thesis."""

    method: Method
    settings: Algorithm3Settings
    seed: int

    def settings_report(self) -> Report | None:
        """Return the thesis's settings for JSON; None for a method without any."""
        if self.method != "thesis":
            return None
        alpha = "auto" if self.settings.alpha is None else self.settings.alpha
        return asdict(self.settings) | {"alpha": alpha, "features": self.settings.features.name}


def align_maps(
    a: Path, b: Path, output: Path | None = None, *, method: Method, settings: Algorithm3Settings, seed: int
) -> Report:
    """Register two map files; (dx, dy, theta_deg) is the pose of b's map frame in a's. Raises MapFileError.

    output: a folder for alignment.png, the verdict as a picture, and alignment.json.
    """
    check_run_folder(output)
    grids = [_load(path) for path in (a, b)]
    registration = _Registration(method, settings, seed)
    alignment, seconds = _timed_register(grids[0], grids[1], registration)
    report: Report = {
        "method": method,
        "accepted": alignment.accepted,
        **_certainty_fields(alignment),
        "acceptance": round(alignment.acceptance, 4),
        "inliers": alignment.inliers,
        "overlap": round(alignment.overlap, 4),
        "common_wall_m": _rounded(alignment.common_wall_m),
        "conflict_m": _rounded(alignment.conflict_m),
        "ambiguous": alignment.ambiguous,
        "scale": alignment.scale,
        "reason": alignment.reason,
        "settings": registration.settings_report(),
        "seconds": round(seconds, 3),
    }
    if output is not None:
        folder = new_run_folder(output)
        with writing_to(folder):
            picture = draw_alignment(grids[0], grids[1], _view(alignment, (a.name, b.name)))
            write_picture(folder / "alignment.png", picture)
            (folder / "alignment.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return report


def _view(alignment: Alignment, names: tuple[str, str]) -> AlignmentView:
    """Return what the picture of a verdict tells."""
    verdict = "accepted" if alignment.accepted else "ambiguous" if alignment.ambiguous else "refused"
    return AlignmentView(
        verdict,
        alignment.reason,
        T_a_b=alignment.T_a_b,
        probability=alignment.probability,
        covariance=alignment.covariance,
        acceptance=alignment.acceptance,
        overlap=alignment.overlap,
        common_wall_m=alignment.common_wall_m,
        conflict_m=alignment.conflict_m,
        alternatives=tuple((each.T_a_b, each.probability) for each in alignment.alternatives),
        slide=alignment.slide,
        names=names,
    )


def fuse_maps(
    files: Sequence[Path], output: Path | None, *, method: Method, settings: Algorithm3Settings, seed: int
) -> tuple[Path, Report]:
    """Fuse one or two map files into a folder, global_<k>.yaml/.pgm/.npz/.png and report.json; return both.

    Maps that do not belong together become a global map each; a map without a known cell is skipped. The order of the
    files changes nothing but the order in the report. Raises MapFileError, ToolError and UsageError.
    """
    if len(files) > _MOST_MAPS:
        raise UsageError(f"{len(files)} maps given: this release fuses two at a time; fuse the result with the next")
    check_result_folder(output, FUSED, files)
    grids = [_load(path) for path in files]
    usable = [number for number, grid in enumerate(grids) if grid.known.any()]
    for number in sorted(set(range(len(files))) - set(usable)):
        log.warning("%s: no known cell: skipped", files[number])
    registration = _Registration(method, settings, seed)
    groups, pairs = _grouped(files, grids, usable, registration)
    report: Report = {
        "maps": [_map_entry(str(path), number, groups) for number, path in enumerate(files)],
        "pairs": pairs,
        "method": method,
        "settings": registration.settings_report(),
        "seed": seed,
    }
    folder = new_results(output, FUSED)
    _save(folder, groups, report)
    return folder, report


def _load(path: Path) -> OccupancyGrid:
    loaded = read_map_with_warnings(path)
    for warning in loaded.warnings:
        log.warning("%s", warning)
    return loaded.grid


def _timed_register(a: OccupancyGrid, b: OccupancyGrid, registration: _Registration) -> tuple[Alignment, float]:
    warm_up(registration.method)
    started = time.perf_counter()
    alignment = register(a, b, registration.method, registration.seed, registration.settings)
    return alignment, time.perf_counter() - started


def _grouped(
    files: Sequence[Path], grids: Sequence[OccupancyGrid], usable: Sequence[int], registration: _Registration
) -> tuple[list[_Group], list[Report]]:
    """Return the groups, the one with the best reference first, and the report on each pair."""
    alone = [_Group(grids[number], {number: se2.IDENTITY}) for number in usable]
    alone.sort(key=lambda group: reference_rank(group.grid))
    if len(usable) < _MOST_MAPS:
        return alone, []
    a, b = grids
    alignment, seconds = _timed_register(a, b, registration)
    pair: Report = {
        "a": str(files[0]),
        "b": str(files[1]),
        "accepted": alignment.accepted,
        **_certainty_fields(alignment),
        "reason": alignment.reason,
        "same_evidence": same_evidence(a, b),
        "seconds": round(seconds, 3),
    }
    if not alignment.accepted or alignment.T_a_b is None:
        return alone, [pair]
    fused = fuse_pair(a, b, alignment.T_a_b)
    return [_Group(fused.grid, {0: fused.T_global_a, 1: fused.T_global_b})], [pair]


def _certainty_fields(alignment: Alignment) -> Report:
    """Return the pose, how sure it is, and what else it could be."""
    alternatives = [{**_pose_fields(other.T_a_b), "probability": other.probability} for other in alignment.alternatives]
    return {
        "probability": alignment.probability,
        **_pose_fields(alignment.T_a_b),
        "covariance": None if alignment.covariance is None else alignment.covariance.tolist(),
        "alternatives": alternatives,
    }


def _rounded(length_m: float | None) -> float | None:
    return None if length_m is None else round(length_m, 2)


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
    """Write the global maps and the report."""
    with writing_to(folder):
        for k, group in enumerate(groups):
            sources = [entry["file"] for entry in report["maps"] if entry["group"] == k]
            write_map(folder / f"global_{k}", group.grid, provenance={"source": " + ".join(sorted(sources))})
            write_picture(folder / f"global_{k}.png", draw_map(group.grid))
        partial = folder / "report.json.part"
        partial.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        partial.replace(folder / "report.json")
