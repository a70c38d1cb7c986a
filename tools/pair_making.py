"""Map pairs with their truth, written as map files: windows of drives in several kinds, and finished maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.evaluation import common_free_points
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_image import encode_image
from mapping.map_yaml import MapMode, MapYaml, format_map_yaml
from tools.log_windows import TRIES, PosedScans, WindowPair, as_camera, draw_windows, map_of
from tools.map_bending import bent_map_of, bent_truth, draw_field_pair
from tools.map_changes import changed
from tools.pair_files import MapPair, PairTruth
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.results import writing_to

FloatArray = NDArray[np.float64]
RESOLUTIONS_M = {"lidar": (0.05, 0.05), "resolution": (0.04, 0.10), "camera": (0.05, 0.05)}
_DEFORMED = ("bent", "changed")
WINDOW_KINDS = (*RESOLUTIONS_M, *_DEFORMED)
_BENT_RESOLUTIONS_M, _BENT_CAMERA_SHARE = (0.04, 0.05, 0.10), 0.25
_LEAST_COMMON_M2 = 10.0
_FRAME_M = 20.0


@dataclass(frozen=True, slots=True)
class WindowPlan:
    """How many window pairs of one drive, of `tries` random ones: a_band for each band, `apart` without common free
    space; in which kinds each of them is drawn; and how far bent ones are, see map_bending.draw_field_pair.
    """

    a_band: int = 8
    apart: int = 12
    kinds: tuple[str, ...] = tuple(RESOLUTIONS_M)
    tries: int = TRIES
    bend_m: tuple[float, float] | None = None


def window_pairs(folder: Path, scans: PosedScans, plan: WindowPlan, seed: int) -> list[MapPair]:
    """Draw the windows of a drive, write their maps below the folder, and return the pairs.

    Same scans and seed, same pairs. Raises ToolError where the drive is too short.
    """
    random = np.random.default_rng([seed, *scans.building.encode()])
    windows = draw_windows(scans, plan.a_band, plan.apart, random, plan.tries)
    camera = as_camera(scans, random)
    pairs: list[MapPair] = []
    for number, window in enumerate(windows):
        a_maps: dict[float, tuple[Path, OccupancyGrid]] = {}
        stem = f"{scans.building}-{window.band or 'apart'}-{number:02d}"
        for kind in plan.kinds:
            if kind in _DEFORMED:
                pairs += _deformed_pair(folder / f"{stem}-{kind}", (scans, camera), window, kind, plan.bend_m, random)
                continue
            T_b_log = random_frame(random)
            resolution_a, resolution_b = RESOLUTIONS_M[kind]
            if resolution_a not in a_maps:
                grid = map_of(scans, window.first, resolution_a, se2.IDENTITY)
                a_maps[resolution_a] = write_scale_map(folder / f"{stem}-a{resolution_a * 100:02.0f}", grid), grid
            b = map_of(camera if kind == "camera" else scans, window.second, resolution_b, T_b_log)
            pair = _judged_pair(f"{stem}-{kind}", scans.building, window, kind, (a_maps[resolution_a], b, T_b_log))
            if pair is not None:
                pairs.append(replace(pair, b=write_scale_map(folder / f"{stem}-b-{kind}", b)))
    return pairs


def _judged_pair(
    name: str,
    building: str,
    window: WindowPair,
    kind: str,
    maps: tuple[tuple[Path, OccupancyGrid], OccupancyGrid, FloatArray],
) -> MapPair | None:
    """Return the pair, b still without a file; None for one of a place where this kind leaves too little in common."""
    (a_path, a), b, T_b_log = maps
    pair = MapPair(name, a_path, Path(), building, building, kind, window.band)
    if window.band is None:
        return pair
    T_a_b = se2.inverse(T_b_log)
    common = common_free(a, b, T_a_b)
    if common.area_m2 < _LEAST_COMMON_M2:
        return None
    points_b = common_free_points(a, b, T_a_b)
    return replace(
        pair,
        overlap=common.share,
        common_wall_m=common_wall_m(wall_line(a), wall_line(b), T_a_b),
        truth=PairTruth(T_a_b, se2.transform_points(T_a_b, points_b), points_b),
    )


def _deformed_pair(
    stem: Path,
    scans: tuple[PosedScans, PosedScans],
    window: WindowPair,
    kind: str,
    bend_m: tuple[float, float] | None,
    random: np.random.Generator,
) -> list[MapPair]:
    """Write two maps, each bent by a field of its own, and return their pair; none where too little is in common.

    scans: of the lidar, and as a camera sees them, which a quarter of the second maps do. kind: bent or changed;
    bend_m: how far it is bent, as in WindowPlan.
    """
    fields = draw_field_pair(random, bend_m)
    seen = scans[0], scans[1] if random.random() < _BENT_CAMERA_SHARE else scans[0]
    resolution_a, resolution_b = random.choice(_BENT_RESOLUTIONS_M, 2).tolist()
    T_b_log = random_frame(random)
    building = scans[0].building
    a = bent_map_of(seen[0], window.first, resolution_a, se2.IDENTITY, fields[0])
    b = bent_map_of(seen[1], window.second, resolution_b, T_b_log, fields[1])
    if kind == "changed":
        a, b = changed(a, random), changed(b, random)
    pair = MapPair(stem.name, Path(), Path(), building, building, kind, window.band)
    if window.band is not None:
        truth = bent_truth(seen, (window.first, window.second), fields, T_b_log)
        common = None if truth is None else common_free(a, b, truth.T_a_b)
        if truth is None or common is None or common.area_m2 < _LEAST_COMMON_M2:
            return []
        wall_m = common_wall_m(wall_line(a), wall_line(b), truth.T_a_b)
        pair = replace(pair, overlap=common.share, common_wall_m=wall_m, truth=truth)
    paths = [write_scale_map(stem.with_name(f"{stem.name}-{part}"), grid) for part, grid in (("a", a), ("b", b))]
    return [replace(pair, a=paths[0], b=paths[1])]


def random_frame(random: np.random.Generator) -> FloatArray:
    """Return a pose (3,) at any angle, up to 20 m off either way."""
    return np.array([*random.uniform(-_FRAME_M, _FRAME_M, 2), random.uniform(-np.pi, np.pi)])


def write_scale_map(stem: Path, grid: OccupancyGrid) -> Path:
    """Write <stem>.yaml and .png with every probability to one per cent, unknown transparent; return the YAML's path.

    The thresholds are 0 and 1, so that what is read is the probability itself. With the usual ones map_server stretches
    what lies between them: p = 0.6 would be read as 0.9, a wall.
    """
    x, y, yaw = grid.origin.tolist()
    image = stem.with_name(stem.name + ".png")
    settings = MapYaml(image, MapMode.SCALE, grid.resolution_m, (x, y, yaw), occupied_thresh=1.0, free_thresh=0.0)
    return _write_files(settings, encode_image(grid, MapMode.SCALE, "png"))


def copy_map(stem: Path, image: Path, settings: MapYaml, shift_m: FloatArray) -> Path:
    """Copy an image as it is, beside a YAML with these settings and the origin moved by shift_m (2,)."""
    x, y, yaw = settings.origin
    moved = (x + float(shift_m[0]), y + float(shift_m[1]), yaw)
    target = stem.with_name(stem.name + image.suffix)
    return _write_files(replace(settings, image=target, origin=moved), image.read_bytes())


def _write_files(settings: MapYaml, image: bytes) -> Path:
    path = settings.image.with_suffix(".yaml")
    with writing_to(path):
        settings.image.write_bytes(image)
        path.write_text(format_map_yaml(settings), encoding="utf-8")
    return path
