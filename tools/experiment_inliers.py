"""Experiments 4.5 and 4.6: inlier precision and count between maps of different resolution, by features and model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from fusion.features import FeatureMethod, Features
from fusion.occupancy_image import rescale_bicubic, turn_nearest
from mapping.map_io import read_map
from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.experiment_keypoints import NAMES, NO_SURF
from tools.feature_plots import HeatMap, draw_heat_maps
from tools.finished_rows import FinishedRows, finish_rows
from tools.heterogeneous_set import grid_of, heterogeneous_set
from tools.map_data_set import DataSetMap, MapDataSet, data_hash
from tools.matched_images import METHODS, Match, agreement, image_name, image_of, putative_matches, timed_features
from tools.results import Report

IMAGES = (None, 0.99)  # O, and O^free with the thesis's alpha
CORNERS = (
    FeatureMethod("brisk"),
    FeatureMethod("harris", "brisk"),
    FeatureMethod("shi-tomasi", "brisk"),
)  # left out of figures
MODELS = {"similarity": "similarity (method 2)", "rigid": "rigid (method 1)"}
RIGHT_DEG, RIGHT_SCALE = 5.0, 0.05  # of a motion between maps of one frame, whose turn is 0
TURN_DEG, TURNED_TO_CELLS_PER_METER = 31.0, 12.0  # maps of one drive lie alike, those of two robots do not
_MATLAB = "with MATLAB's limit of distance"


@dataclass(frozen=True, slots=True)
class _Figure:
    """A figure of the thesis, what its matrices show, and that of one matching; shares: they are parts of 1."""

    number: str
    what: str
    value: Callable[[Report], float | None]
    shares: bool


def inlier_precision(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Return inliers a match between all maps of the highest rate (4.1, figure 4.5)."""
    return _matrices(data, settings, folder, _Figure("4.5", "inlier precision", _precision, shares=True))


def inlier_count(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Return how many inliers MSAC finds between all maps of the highest rate (figure 4.6)."""
    figure = _Figure("4.6", "inliers of MSAC", lambda cell: float(cell["inliers"]), shares=False)
    return _matrices(data, settings, folder, figure)


def _matrices(data: MapDataSet, settings: ExperimentSettings, folder: Path, figure: _Figure) -> Experiment:
    """Match every map of the highest rate with each, itself too; both figures show the same rows."""
    maps = heterogeneous_set(data)
    of_rate = maps.of_rate(maps.every[0])
    tasks = {
        f"{image_name(alpha)}, {method.detector}, to {fixed.name}": (of_rate, fixed, alpha, method, settings.seed)
        for alpha in IMAGES
        for method in (*METHODS, *CORNERS)
        for fixed in of_rate
    }
    rows = FinishedRows(folder.parent / "matches.jsonl", f"{data_hash(data)} {settings.seed}")
    found = finish_rows(rows, matches_to, tasks, settings.jobs, figure.number)
    fixed = min(of_rate, key=lambda each: abs(each.cells_per_meter - TURNED_TO_CELLS_PER_METER))
    others = [each for each in of_rate if each is not fixed]
    turned_tasks = {
        f"{image_name(alpha)}, {method.detector}, turned by {turn_deg:g} deg, to {fixed.name}": (
            others, fixed, alpha, method, settings.seed, turn_deg,
        )
        for alpha in IMAGES
        for method in METHODS
        for turn_deg in (0.0, TURN_DEG)
    }  # fmt: skip
    turned = finish_rows(rows, turned_matches_to, turned_tasks, settings.jobs, figure.number)
    pictures, tables = [], [_summary(of_rate, found), _turned_table(turned, fixed, len(others))]
    ticks = [f"{each.cells_per_meter:g}" for each in of_rate]
    for alpha in IMAGES:
        heat_maps = [
            _heat_map(f"{NAMES[method.detector]}, {title}", _cells(of_rate, found, alpha, method, model), figure)
            for model, title in MODELS.items()
            for method in METHODS
        ]
        title = f"{data.label}: {figure.what}, {image_name(alpha)}, {maps.rate_name(maps.every[0])}"
        labels = "r of the moving map, cells/m", "r of the fixed map, cells/m"
        draw = partial(draw_heat_maps, maps=heat_maps, columns=len(METHODS), ticks=ticks, labels=labels, title=title)
        pictures.append(Picture(f"Figure {figure.number} on {image_name(alpha)}: {data.label}", draw))
        tables += [_table(each, ticks, image_name(alpha)) for each in heat_maps]
    pictures.reverse()  # O^free first, as Algorithm 3 takes it
    note = (
        "Similarity: each map at its own resolution, MSAC estimates the scale. Rigid: the moving map is rescaled to "
        "the fixed one's cells first (bicubic), MSAC estimates no scale. One run of MSAC each. Harris and Shi-Tomasi "
        "corners, which have no descriptor, have BRISK's."
    )
    return Experiment(tables, pictures, {"matches": found}, [note, NO_SURF])


def matches_to(
    maps: Sequence[DataSetMap], fixed: DataSetMap, alpha: float | None, method: FeatureMethod, seed: int
) -> Report:
    """Match all maps with one by one kind of features; a cell for each model and moving map."""
    fixed_grid = grid_of(fixed)
    target = _own_features(fixed.path, alpha, method)
    row: Report = {"keypoints": len(target.points)}
    for moving in maps:
        grid = grid_of(moving)
        image = image_of(grid, alpha)
        for model in MODELS:
            similarity = model == "similarity"
            if similarity or moving.resolution_m == fixed.resolution_m:
                features = _own_features(moving.path, alpha, method)
            else:
                rescaled = rescale_bicubic(image, grid.resolution_m, fixed_grid.resolution_m)
                features = timed_features(rescaled, method).features
            true_scale = grid.resolution_m / fixed_grid.resolution_m if similarity else 1.0
            putative = putative_matches(target, features)
            for matlab in (False, True):
                match = agreement(putative, seed, similarity=similarity, only_near=matlab)
                cell = asdict(match) | {"right": is_right(match, true_scale), "keypoints": len(features.points)}
                row[_cell_key(model, moving, matlab=matlab)] = cell
    return row


def turned_matches_to(
    maps: Sequence[DataSetMap],
    fixed: DataSetMap,
    alpha: float | None,
    method: FeatureMethod,
    seed: int,
    turn_deg: float,
) -> Report:
    """Match maps, turned first (nearest neighbour), with one by the rigid model: sums over the maps.

    Keypoints of the moving maps, and of both ways to choose matches their number and the inliers.
    """
    target = _own_features(fixed.path, alpha, method)
    row = dict.fromkeys(("keypoints", "matches", "inliers", "near_matches", "near_inliers"), 0)
    for moving in maps:
        image = turn_nearest(image_of(grid_of(moving), alpha), math.radians(turn_deg))
        rescaled = rescale_bicubic(image, moving.resolution_m, fixed.resolution_m)
        features = timed_features(rescaled, method).features
        putative = putative_matches(target, features)
        row["keypoints"] += len(features.points)
        for prefix, only_near in (("", False), ("near_", True)):
            match = agreement(putative, seed, similarity=False, only_near=only_near)
            row[f"{prefix}matches"] += match.matches
            row[f"{prefix}inliers"] += match.inliers
    return row


@lru_cache(maxsize=64)
def _own_features(path: Path, alpha: float | None, method: FeatureMethod) -> Features:
    """Return the features of a map at its own resolution, which every other map is matched with."""
    return timed_features(image_of(read_map(path), alpha), method).features


def is_right(match: Match, true_scale: float) -> bool:
    """Whether a motion between two maps of one frame is near none, and its scale near the ratio of their cells."""
    if match.turn_rad is None or match.scale is None:
        return False
    turned = abs(math.degrees(match.turn_rad)) > RIGHT_DEG
    return not turned and abs(match.scale / true_scale - 1.0) <= RIGHT_SCALE


def _cell_key(model: str, moving: DataSetMap, *, matlab: bool) -> str:
    return f"{model}, {moving.name}{f', {_MATLAB}' if matlab else ''}"


def _precision(cell: Report) -> float | None:
    return cell["inliers"] / cell["matches"] if cell["matches"] else None


def _cells(
    maps: Sequence[DataSetMap],
    found: Mapping[str, Report],
    alpha: float | None,
    method: FeatureMethod,
    model: str,
    *,
    matlab: bool = False,
) -> list[list[Report]]:
    """Return a row for each fixed map, with a cell for each moving one."""
    rows = [found[f"{image_name(alpha)}, {method.detector}, to {fixed.name}"] for fixed in maps]
    return [[row[_cell_key(model, moving, matlab=matlab)] for moving in maps] for row in rows]


def _heat_map(title: str, cells: Sequence[Sequence[Report]], figure: _Figure) -> HeatMap:
    of_cells = [[figure.value(cell) for cell in row] for row in cells]
    values = np.array([[np.nan if value is None else value for value in row] for row in of_cells])
    # A map with itself has many times the inliers of two maps: its colour is the darkest, and no measure of the others.
    apart = values[~np.eye(len(values), dtype=np.bool_)]
    most = 1.0 if figure.shares else max(1.0, float(np.nanmax(apart, initial=0.0)))
    form = ".2f" if figure.shares else ".0f"
    texts = [["-" if value is None else format(value, form) for value in row] for row in of_cells]
    return HeatMap(title, values, texts, most)


def _table(each: HeatMap, ticks: Sequence[str], image: str) -> Table:
    rows = [[tick, *texts] for tick, texts in zip(ticks, each.texts, strict=True)]
    return Table(f"{each.title}, {image}", ["fixed r \\ moving r", *ticks], rows)


def _turned_table(turned: Mapping[str, Report], fixed: DataSetMap, maps: int) -> Table:
    """Return what a turn of the moving maps does, which maps of one drive lack."""
    rows = []
    for key, row in turned.items():
        image, detector, turn, _ = key.rsplit(", ", 3)
        for name, prefix in (("no", ""), ("yes", "near_")):
            matches, inliers = row[f"{prefix}matches"], row[f"{prefix}inliers"]
            precision = f"{inliers / matches:.2f}" if matches else "-"
            means = [f"{number / maps:.0f}" for number in (row["keypoints"], matches, inliers)]
            rows.append([image, NAMES[detector], turn.removeprefix("turned by "), name, *means, precision])
    title = f"Turned maps: means of matching the {maps} other maps with {fixed.name}, rigid"
    heads = ["image", "features", "turn", "MATLAB's limit", "keypoints", "matches", "inliers", "precision"]
    return Table(title, heads, rows, "Maps of one drive lie alike; those of two robots, and the rows of 4.7, do not.")


def _summary(maps: Sequence[DataSetMap], found: Mapping[str, Report]) -> Table:
    """Return means over all pairs of two resolutions."""
    rows = []
    for alpha in IMAGES:
        for method in (*METHODS, *CORNERS):
            for model in MODELS:
                for matlab in (False, True):
                    cells = _cells(maps, found, alpha, method, model, matlab=matlab)
                    apart = [cell for a, row in enumerate(cells) for b, cell in enumerate(row) if a != b]
                    rows.append(
                        [image_name(alpha), NAMES[method.detector], model, "yes" if matlab else "no", *_means(apart)]
                    )
    title = "Means over the pairs of different resolutions"
    heads = ["image", "features", "model", "MATLAB's limit", "matches", "inliers", "precision", "right motion"]
    note = (
        f"Precision: all inliers over all matches. Right: turned by at most {RIGHT_DEG:g} deg, and the scale within "
        f"{RIGHT_SCALE:.0%} of the ratio of the resolutions. MATLAB's limit: matches further apart than matchFeatures "
        "accepts by default (10 % of the bits, SSD of unit vectors 0.04) are dropped; the pictures are without it."
    )
    return Table(title, heads, rows, note)


def _means(cells: Sequence[Report]) -> list[str]:
    matches, inliers = (sum(cell[key] for cell in cells) for key in ("matches", "inliers"))
    right = sum(cell["right"] for cell in cells)
    share = f"{inliers / matches:.2f}" if matches else "-"
    return [f"{matches / len(cells):.0f}", f"{inliers / len(cells):.0f}", share, f"{right} of {len(cells)}"]
