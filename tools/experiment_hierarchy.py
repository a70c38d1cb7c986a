"""Figures 5.5 and 5.6: several robots' maps made one, in levels as in the thesis, and by the default method."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.fused_set import FusedSet, fuse_set, is_several
from tools.fusion_files import TREE_NAME
from tools.local_maps_picture import draw_local_maps
from tools.map_data_set import MapDataSet
from tools.merging_methods import METHODS
from tools.results import Report

FUSED_FOLDER = "fused"  # beside the experiments' own folders: figure 5.7 is of the same maps
_COLUMNS = ("method", "maps a group", "worst map, m", "worst map, deg", "wrong maps", "pairs accepted", "s")
_NOTE = (
    "Maps a group: those that were not merged are groups of one. Error: of the pose in the group, against "
    "the truth, rms over the map's free cells. Wrong: off by over 0.5 m or 3 deg; bent maps by over their own "
    "bend plus 15 pixels, or 5 deg. Seconds: wall clock of all registrations, summed."
)


def lacks(data: MapDataSet) -> str | None:
    """Return what a set lacks: three or more maps of as many robots."""
    return None if is_several(data) else "not three or more maps, each of another robot: make a set of the kind robots"


def run(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Fuse all maps by each method."""
    fused = {name: fused_by(data, name, settings, folder) for name in METHODS}
    lines = [_texts(METHODS[name].title, each) for name, each in fused.items()]
    orders = [
        Table(
            f"Order of merging: {METHODS[name].title}",
            ("level", "merged", "inliers", "omega"),
            _order(each.report, data),
        )
        for name, each in fused.items()
        if each.report.get("levels")
    ]
    details = [_map_table(METHODS["default"].title, fused["default"])]
    note = f"{'Simulated' if data.simulated else 'Real'} data."
    pictures = []
    if all(each.pose is not None for each in data.maps):
        caption = f"The local maps at their true poses (figure 5.5). {note}"
        pictures.append(Picture(caption, partial(draw_local_maps, data=data)))
    caption = f"Merging in levels (figure 5.6): {METHODS['real'].title}. {note}"
    pictures.append(Picture(caption, partial(_copy, fused["real"].folder / TREE_NAME)))
    caption = f"The largest global map by the default method, with the robots' trajectories in it. {note}"
    pictures.append(Picture(caption, partial(_copy, fused["default"].folder / "global_0.png")))
    figures = {name: _figures(each) for name, each in fused.items()}
    return Experiment(
        [Table(f"{len(data.maps)} maps into one", _COLUMNS, lines, _NOTE), *orders, *details], pictures, figures
    )


def fused_by(data: MapDataSet, method: str, settings: ExperimentSettings, folder: Path) -> FusedSet:
    """Fuse a set's maps beside an experiment's folder; what another experiment registered is not registered again."""
    return fuse_set(data, method, settings.seed, settings.jobs, folder.parent / FUSED_FOLDER / method)


def _copy(source: Path, file: Path) -> None:
    shutil.copyfile(source, file)


def _texts(title: str, fused: FusedSet) -> list[str]:
    worst = fused.worst()
    errors = ["-", "-"] if worst is None else [f"{worst[0]:.3f}", f"{worst[1]:.2f}"]
    pairs = fused.report["pairs"]
    return [
        title,
        " + ".join(map(str, fused.group_sizes)),
        *errors,
        "-" if worst is None else str(sum(each.right is False for each in fused.maps)),
        f"{sum(pair['accepted'] for pair in pairs)} of {len(pairs)}",
        f"{sum(pair['seconds'] for pair in pairs):.0f}",
    ]


def _order(report: Report, data: MapDataSet) -> list[list[str]]:
    """Return the merges of each level as the thesis writes them: {a, b}."""
    names = {str(each.path): each.robot or each.name for each in data.maps}
    rows = []
    for level in report["levels"]:
        for merged in level["merged"]:
            parts = ["{" + ", ".join(sorted(names[file] for file in merged[side])) + "}" for side in ("a", "b")]
            rows.append([str(level["level"]), " + ".join(parts), str(merged["inliers"]), f"{merged['acceptance']:.3f}"])
    return rows


def _map_table(title: str, fused: FusedSet) -> Table:
    columns = ("map", "r", "T, Hz", "every k-th scan", "group", "error, m", "error, deg")
    rows = []
    for each in fused.maps:
        rate = "-" if each.map.rate_hz is None else f"{each.map.rate_hz:.3f}"
        every = "-" if each.map.scan_every is None else str(each.map.scan_every)
        errors = ["-", "-"] if each.error_m is None else [f"{each.error_m:.3f}", f"{each.error_deg:.2f}"]
        rows.append(
            [each.map.robot or each.map.name, f"{each.map.cells_per_meter:g}", rate, every, str(each.group), *errors]
        )
    return Table(f"Each map: {title}", columns, rows)


def _figures(fused: FusedSet) -> Report:
    return {
        "group_sizes": fused.group_sizes,
        "worst": fused.worst(),
        "maps": [
            {
                "map": each.map.name,
                "group": each.group,
                "T_global_map": each.T_global_map.tolist(),
                "error_m": each.error_m,
                "error_deg": each.error_deg,
                "right": each.right,
            }
            for each in fused.maps
        ],
        "pairs": fused.report["pairs"],
        "levels": fused.report.get("levels"),
        "settings": fused.report["settings"],
    }
