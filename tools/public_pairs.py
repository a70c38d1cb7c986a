"""The named set of map pairs from public data sets: drives, warped tablet maps, finished maps of other buildings."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.map_yaml import MapMode, MapYaml, read_map_yaml
from tools.errors import ToolError
from tools.pair_files import MapPair, PairTruth
from tools.pair_making import WindowPlan, copy_map, window_pairs, write_scale_map
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.real_maps import HALMSTAD_M_PER_PX, LOG_REACH_M, halmstad_points, read_corrected_log, read_text_grid

FloatArray = NDArray[np.float64]
ORIGIN = "corrected CARMEN logs (ple), Halmstad tablet maps, and finished maps; see the licences of each data set"
_HALMSTAD_MAPS = {"F5": 14, "HIH": 4, "KPT4A": 4}
_RIGHT_PX, _WARPED_RIGHT_DEG = 15.0, 5.0
_SHIFT_M = 20.0
_CORRIDOR_M_PER_PX = 0.1  # the data set states none: its corridors are then 1.7 m wide
_FINISHED = {
    "aaf": ("maps_strands/aaf_deployment16-cropped.yaml",),
    "freiburg-079": tuple(f"maps_freiburg079_incremental/map{number}.yaml" for number in (3, 6, 9, 12, 15)),
    "cartesium": ("maps_freiburg079_incremental/ubremen-cartesium.yaml",),
    "simona-house": ("maps_freiburg079_incremental/simona-house.yaml",),
    "intel": ("maps_planning/intel-lab.yaml",),
    "depot": ("maps_planning/depot.yaml",),
    "olin-ac109": tuple(f"maps_olin_ac109/ac109_{number}.yaml" for number in (1, 2, 3, 4)),
}
_CORRIDORS = ("maps_carpin_merced/LongCorridor1.txt", "maps_carpin_merced/LongCorridor2.txt")


@dataclass(frozen=True, slots=True, eq=False)
class BuildingMap:
    """A map of a building: kind is that of the pairs in which it is the second, "finished" where it has none."""

    building: str
    path: Path
    kind: str
    resolution_m: float


def public_pairs(folder: Path, data: Path, seed: int, jobs: int, on_progress: Callable[[str], None]) -> list[MapPair]:
    """Write the whole set's maps below a folder and return its pairs: same data and seed, same pairs.

    jobs: processes. Raises ToolError and MapFileError where the data are not there.
    """
    if not (data / "carmen_ple").is_dir():
        raise ToolError(f"{data}: no folder carmen_ple in it: name the folder of the data sets")
    pairs: list[MapPair] = []
    maps: list[BuildingMap] = []
    work = partial(_log_pairs, folder, data, seed)
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for building, found in zip(LOG_REACH_M, pool.map(work, LOG_REACH_M), strict=True):
            pairs += found
            maps += maps_of_pairs(found)
            on_progress(f"{building}: {sum(pair.truth is not None for pair in found)} true pairs of {len(found)}")
    random = np.random.default_rng(seed)
    warped = halmstad_maps(folder, data / "maps_halmstad", random)
    pairs += halmstad_pairs(data / "maps_halmstad", warped)
    finished = finished_maps(folder, data, random)
    others = other_building_pairs(maps, [each for each, _ in warped.values()], finished, random)
    on_progress(f"Halmstad: {len(warped)} maps; {len(others)} pairs of different buildings")
    return pairs + others


def _log_pairs(folder: Path, data: Path, seed: int, building: str) -> list[MapPair]:
    scans = read_corrected_log(data / f"carmen_ple/{building}-corrected.log.gz", LOG_REACH_M[building])
    return window_pairs(folder, scans, WindowPlan(), seed)


def maps_of_pairs(pairs: Sequence[MapPair]) -> list[BuildingMap]:
    """Return the maps of the pairs, each once: the first of a pair as `first`, the second as the pair's kind."""
    found: dict[Path, BuildingMap] = {}
    for pair in pairs:
        for building, path, kind in ((pair.building_a, pair.a, "first"), (pair.building_b, pair.b, pair.kind)):
            if path not in found:
                found[path] = BuildingMap(building, path, kind, read_map_yaml(path).resolution_m)
    return list(found.values())


def halmstad_maps(
    folder: Path, halmstad: Path, random: np.random.Generator
) -> dict[str, tuple[BuildingMap, FloatArray]]:
    """Copy the tablet maps, each with a random origin; return them by name with the shift (2,) in m of the origin."""
    found = {}
    for building, count in _HALMSTAD_MAPS.items():
        for number in range(1, count + 1):
            name = f"{building}_{number:02d}"
            image = halmstad / f"maps/{building}/pseudo_occupancy/{name}.png"
            if not image.is_file():
                raise ToolError(f"{image}: no such file: get the Halmstad maps, or name another data folder")
            resolution_m = HALMSTAD_M_PER_PX[building]
            shift_m = random.uniform(-_SHIFT_M, _SHIFT_M, 2)
            path = copy_map(folder / name, image, MapYaml(image, MapMode.TRINARY, resolution_m, (0, 0, 0)), shift_m)
            found[name] = BuildingMap(building, path, "warped", resolution_m), shift_m
    return found


def halmstad_pairs(halmstad: Path, maps: Mapping[str, tuple[BuildingMap, FloatArray]]) -> list[MapPair]:
    """Return all pairs of tablet maps of one building: right is what comes within 15 px and 5 deg of the rigid fit."""
    grids = {name: read_map(each.path) for name, (each, _) in maps.items()}
    lines = {name: wall_line(grid) for name, grid in grids.items()}
    pairs = []
    for a, b in combinations(maps, 2):
        (map_a, shift_a), (map_b, shift_b) = maps[a], maps[b]
        if map_a.building != map_b.building:
            continue
        marked = halmstad_points(halmstad, a, b)
        points_a, points_b = marked.points_a + shift_a, marked.points_b + shift_b
        T_a_b = se2.compose(se2.compose([*shift_a, 0.0], marked.T_a_b), [*-shift_b, 0.0])
        right_m = marked.residual_m + _RIGHT_PX * map_a.resolution_m
        pairs.append(
            MapPair(
                f"{a}-{b}", map_a.path, map_b.path, map_a.building, map_b.building, "warped",
                overlap=common_free(grids[a], grids[b], T_a_b).share,
                common_wall_m=common_wall_m(lines[a], lines[b], T_a_b),
                truth=PairTruth(T_a_b, points_a, points_b, right_m, _WARPED_RIGHT_DEG),
            )
        )  # fmt: skip
    return pairs


def finished_maps(folder: Path, data: Path, random: np.random.Generator) -> list[BuildingMap]:
    """Copy finished maps of other buildings, each with a random origin."""
    found = []
    for building, files in _FINISHED.items():
        for file in files:
            settings = read_map_yaml(data / file)
            stem = folder / f"{building}-{Path(file).stem}"
            path = copy_map(stem, settings.image, settings, random.uniform(-_SHIFT_M, _SHIFT_M, 2))
            found.append(BuildingMap(building, path, "finished", settings.resolution_m))
    for file in _CORRIDORS:
        grid = read_text_grid(data / file, _CORRIDOR_M_PER_PX)
        path = write_scale_map(folder / f"merced-{Path(file).stem}", _shifted(grid, random))
        found.append(BuildingMap("merced", path, "finished", _CORRIDOR_M_PER_PX))
    return found


def _shifted(grid: OccupancyGrid, random: np.random.Generator) -> OccupancyGrid:
    x, y, yaw = grid.origin.tolist()
    dx, dy = random.uniform(-_SHIFT_M, _SHIFT_M, 2).tolist()
    return replace(grid, origin=np.array([x + dx, y + dy, yaw]))


def other_building_pairs(
    drives: Sequence[BuildingMap],
    warped: Sequence[BuildingMap],
    finished: Sequence[BuildingMap],
    random: np.random.Generator,
) -> list[MapPair]:
    """Return wrong pairs of different buildings: of drives, 45 in each kind, of tablet maps, and of finished maps."""
    firsts = [each for each in drives if each.kind == "first"]
    coarse = {kind: [each for each in drives if each.kind == kind] for kind in ("lidar", "resolution", "camera")}
    fine = [each for each in firsts if each.resolution_m < 0.045]
    equal = [each for each in firsts if each.resolution_m >= 0.045]
    groups: tuple[tuple[Sequence[BuildingMap], Sequence[BuildingMap], int], ...] = (
        (equal, coarse["lidar"], 45),
        (fine, coarse["resolution"], 45),
        (equal, coarse["camera"], 45),
        (warped, warped, 60),
        (firsts, warped, 60),
        (finished, finished, 35),
        (firsts, finished, 20),
        (finished, warped, 20),
    )
    taken: set[frozenset[Path]] = set()
    pairs: list[MapPair] = []
    for first, second, count in groups:
        for pair in _varied(first, second, count, random, taken):
            pairs.append(replace(pair, name=f"other-{len(pairs):03d}-{pair.name}"))
    return pairs


def _varied(
    first: Sequence[BuildingMap],
    second: Sequence[BuildingMap],
    count: int,
    random: np.random.Generator,
    taken: set[frozenset[Path]],
) -> Iterator[MapPair]:
    """Yield pairs of different buildings, every two buildings in turn, with random maps of each; none twice."""
    buildings = sorted({(a.building, b.building) for a in first for b in second if a.building != b.building})
    order = [buildings[index] for index in random.permutation(len(buildings))]
    found = tried = 0
    while found < count and order and tried < 50 * count:
        building_a, building_b = order[tried % len(order)]
        tried += 1
        a, b = (
            chosen[int(random.integers(len(chosen)))]
            for chosen in (
                [each for each in first if each.building == building_a],
                [each for each in second if each.building == building_b],
            )
        )
        if frozenset((a.path, b.path)) in taken:
            continue
        taken.add(frozenset((a.path, b.path)))
        found += 1
        yield MapPair(f"{a.path.stem}-{b.path.stem}", a.path, b.path, building_a, building_b, _kind(a, b))


def _kind(a: BuildingMap, b: BuildingMap) -> str:
    for kind in ("warped", "camera"):
        if kind in {a.kind, b.kind}:
            return kind
    ratio = max(a.resolution_m, b.resolution_m) / min(a.resolution_m, b.resolution_m)
    return "resolution" if ratio > 1.5 else "lidar"
