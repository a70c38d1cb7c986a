"""Experiments 4.3 and 4.4: how many keypoints detectors find by resolution, scan rate and processing of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fusion.features import count_keypoints
from fusion.free_space import UNKNOWN
from fusion.occupancy_image import rescale_bicubic
from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.feature_plots import Line, Panel, draw_panels
from tools.finished_rows import FinishedRows, finish_rows
from tools.heterogeneous_set import HeterogeneousSet, grid_of, heterogeneous_set
from tools.map_data_set import DataSetMap, MapDataSet, data_hash
from tools.matched_images import image_name, image_of
from tools.results import Report

DETECTORS = ("brisk", "harris", "shi-tomasi", "kaze", "orb", "sift")  # table 4.2, without SURF
RESCALED_TO = (8.0, 20.0)  # cells/m, section 4.2.1.1
IMAGES = (0.0, None, 0.5, 0.99)  # O with its probabilities, O, O^free as on real maps here, O^free as in the thesis
NAMES = {
    "brisk": "BRISK", "harris": "Harris", "shi-tomasi": "Shi-Tomasi", "kaze": "KAZE", "orb": "ORB", "sift": "SIFT",
}  # fmt: skip
NO_SURF = "SURF, the seventh of table 4.2, is not in OpenCV's wheels and left out."


def keypoints_by_detector(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Count keypoints on O as it is, neither processed nor rescaled, for each r, T and detector (figure 4.3)."""
    maps = heterogeneous_set(data)
    tasks = {each.name: (each,) for each in maps.maps.values()}
    rows = FinishedRows(folder / "keypoints.jsonl", data_hash(data))
    counts = finish_rows(rows, _counts_by_detector, tasks, settings.jobs, "4.3")
    tables = [_table(maps, f"{NAMES[each]}: keypoints of O", each, counts) for each in DETECTORS]
    panels = [Panel(NAMES[each], _lines(maps, each, counts), "r in cells/m", "keypoints") for each in DETECTORS]
    spread = Table(
        "Spread over r: keypoints at the finest resolution as a multiple of those at the coarsest, by rate",
        ["detector", *(maps.rate_name(k) for k in maps.every)],
        [[NAMES[each], *(_growth(maps, k, each, counts) for k in maps.every)] for each in DETECTORS],
    )
    caption = f"Keypoints of O, by detector, resolution r and scan rate T (figure 4.3): {data.label}"
    return Experiment(
        [*tables, spread],
        [Picture(caption, partial(draw_panels, panels=panels, columns=3, title=f"{data.label}: keypoints of O"))],
        {"keypoints": counts},
        [NO_SURF, "No limit on their number: ORB's own one (500) is lifted."],
    )


def rescaled_keypoints(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Count KAZE's keypoints after bicubic rescaling of O and of O^free (figure 4.4)."""
    maps = heterogeneous_set(data)
    tasks = {f"{image_name(alpha)}, {each.name}": (each, alpha) for alpha in IMAGES for each in maps.maps.values()}
    rows = FinishedRows(folder / "rescaled.jsonl", data_hash(data))
    finished = finish_rows(rows, _rescaled_counts, tasks, settings.jobs, "4.4")
    counts = {
        each.name: {
            _key(to, alpha): finished[f"{image_name(alpha)}, {each.name}"][f"{to:g}"]
            for to in RESCALED_TO
            for alpha in IMAGES
        }
        for each in maps.maps.values()
    }
    tables, panels, spreads = [], [], []
    for to in RESCALED_TO:
        for alpha in IMAGES:
            key, title = _key(to, alpha), f"{image_name(alpha)} rescaled to {to:g} cells/m"
            tables.append(_table(maps, f"{title}: KAZE keypoints", key, counts))
            panels.append(Panel(title, _lines(maps, key, counts), "r of the map in cells/m", "KAZE keypoints"))
            spreads.append([f"{to:g}", image_name(alpha), *_deviations(maps, key, counts)])
    stability = Table(
        "Stability: standard deviation of the counts over r in per cent of their mean (least is the most stable)",
        ["to, cells/m", "image", *(maps.rate_name(k) for k in maps.every), "over r and T"],
        spreads,
    )
    caption = f"KAZE keypoints after rescaling to 8 (top) and 20 cells/m (bottom) (figure 4.4): {data.label}"
    draw = partial(draw_panels, panels=panels, columns=len(IMAGES), title=f"{data.label}: KAZE keypoints, rescaled")
    return Experiment([stability, *tables], [Picture(caption, draw)], {"keypoints": counts})


def _counts_by_detector(each: DataSetMap) -> Report:
    image = image_of(grid_of(each), None)
    return {detector: count_keypoints(image, detector) for detector in DETECTORS}


def _rescaled_counts(each: DataSetMap, alpha: float | None) -> Report:
    grid = grid_of(each)
    image, outside = image_of(grid, alpha), 0 if alpha != 0.0 else UNKNOWN
    return {
        f"{to:g}": count_keypoints(rescale_bicubic(image, grid.resolution_m, 1.0 / to), "kaze", outside)
        for to in RESCALED_TO
    }


def _key(to: float, alpha: float | None) -> str:
    return f"{image_name(alpha)} to {to:g}"


def _numbers(maps: HeterogeneousSet, k: int, key: str, counts: Mapping[str, Report]) -> list[int]:
    """Return the counts of one rate, by resolution."""
    return [int(counts[each.name][key]) for each in maps.of_rate(k)]


def _table(maps: HeterogeneousSet, title: str, key: str, counts: Mapping[str, Report]) -> Table:
    """Return counts with a row for each resolution and a column for each rate."""
    rows = []
    for r in maps.resolutions:
        of_r = [counts[maps.maps[k, r].name][key] if (k, r) in maps.maps else None for k in maps.every]
        rows.append([f"{r:g}", *("-" if count is None else str(count) for count in of_r)])
    return Table(title, ["r, cells/m", *(maps.rate_name(k) for k in maps.every)], rows)


def _lines(maps: HeterogeneousSet, key: str, counts: Mapping[str, Report]) -> list[Line]:
    return [
        Line(maps.rate_name(k), [each.cells_per_meter for each in maps.of_rate(k)], _numbers(maps, k, key, counts))
        for k in maps.every
    ]


def _growth(maps: HeterogeneousSet, k: int, key: str, counts: Mapping[str, Report]) -> str:
    numbers = _numbers(maps, k, key, counts)
    return f"{numbers[-1] / numbers[0]:.2f}" if numbers[0] else "-"


def _deviations(maps: HeterogeneousSet, key: str, counts: Mapping[str, Report]) -> list[str]:
    """Return the relative deviation of the counts of each rate, and of all."""
    numbers = [_numbers(maps, k, key, counts) for k in maps.every]
    return [_deviation(each) for each in (*numbers, [count for of_rate in numbers for count in of_rate])]


def _deviation(numbers: Sequence[int]) -> str:
    mean = float(np.mean(numbers))
    return f"{100.0 * float(np.std(numbers)) / mean:.0f} %" if mean else "-"
