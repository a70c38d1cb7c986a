"""Pairs of real maps with known relative pose, and pairs of different places, from public data sets.

The second map of a pair is drawn anew in a random frame (any angle, 20 m either way), so that neither "they lie as they
are" nor "refuse everything" scores. Windows of corrected logs are drawn from the scans in that frame; finished maps are
looked up cell by cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.evaluation import common_free_points
from fusion.resampling import known_corners, raster_around, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.errors import ToolError
from tools.real_maps import (
    HALMSTAD_M_PER_PX,
    CorrectedLog,
    halmstad_points,
    map_of,
    read_corrected_log,
    read_picture_map,
)

FloatArray = NDArray[np.float64]
LOGS = {"belgioioso": 15.0, "csail": 15.0, "edmonton": 25.0, "fhw": 15.0, "freiburg-101": 15.0}  # reach in m
BANDS = {"low": (0.15, 0.35), "mid": (0.35, 0.60), "high": (0.60, 1.0)}  # shared free space, of the smaller map's
_RESOLUTIONS = {"low": (0.05, 0.05), "mid": (0.05, 0.05), "high": (0.04, 0.10)}
_TRIES, _COARSE_M, _LEAST_COMMON_M2 = 400, 0.2, 15.0
_HALMSTAD = (("F5_01", "F5_03"), ("F5_02", "F5_05"), ("F5_03", "F5_04"), ("F5_01", "F5_08"))
_GROWING = ((4, 8), (7, 12), (10, 14))
_RIGHT_M, _RIGHT_DEG = 0.5, 3.0
_HALMSTAD_PX, _HALMSTAD_DEG = 15.0, 5.0


@dataclass(frozen=True, slots=True, eq=False)
class PairTruth:
    """The true pose (3,) of map b in map a, points (N, 2) known in both frames, and what counts as right."""

    T_a_b: FloatArray
    points_a: FloatArray
    points_b: FloatArray
    right_m: float = _RIGHT_M
    right_deg: float = _RIGHT_DEG


@dataclass(frozen=True, slots=True, eq=False)
class MapPair:
    """Two maps, and the truth if they are of one place."""

    name: str
    a: OccupancyGrid
    b: OccupancyGrid
    truth: PairTruth | None = None


def map_pairs(data: Path, seed: int) -> Iterator[MapPair]:
    """Yield pairs of one place, then pairs of different places. Raises ToolError where the data are not there."""
    if not data.is_dir():
        raise ToolError(f"{data}: no such folder: name the folder of the data sets with --data")
    random = np.random.default_rng(seed)
    for name in LOGS:
        for band in BANDS:
            pair = _window_pair(data, name, band, random)
            if pair is not None:
                yield pair
    for earlier, later in _GROWING:
        yield _finished_pair(f"freiburg-079 {earlier}/{later}", _growing(data, earlier), _growing(data, later), random)
    for first, second in _HALMSTAD:
        yield _halmstad_pair(data / "maps_halmstad", first, second, random)
    places = _places(data)
    names = list(places)
    for step in (1, 4):
        for first, second in zip(names, names[step:] + names[:step], strict=True):
            yield MapPair(f"{first} x {second}", places[first], _redrawn(places[second], _random_frame(random)))


def _window_pair(data: Path, name: str, band: str, random: np.random.Generator) -> MapPair | None:
    """Return two windows of one log whose free space overlaps as the band says; None if none is found.

    Windows that overlap in time take every other scan each, so that no scan is in both.
    """
    log = _log(data, name)
    length, low, high = log.travelled_m[-1], *BANDS[band]
    for _ in range(_TRIES):
        spans = random.uniform(max(25.0, 0.08 * length), max(26.0, min(0.45 * length, 250.0)), 2)
        starts = random.uniform(0.0, np.maximum(length - spans, 0.0))
        scans = [
            np.flatnonzero((log.travelled_m >= start) & (log.travelled_m < start + span))
            for start, span in zip(starts, spans, strict=True)
        ]
        if len(np.intersect1d(scans[0], scans[1])):
            scans = [scans[0][scans[0] % 2 == 0], scans[1][scans[1] % 2 == 1]]
        coarse = [map_of(log, part, _COARSE_M, LOGS[name], se2.IDENTITY) for part in scans]
        common_m2, share = _common_free(coarse[0], coarse[1])
        if not (low <= share < high and common_m2 >= _LEAST_COMMON_M2):
            continue
        T_b_log = _random_frame(random)
        resolution_a, resolution_b = _RESOLUTIONS[band]
        a = map_of(log, scans[0], resolution_a, LOGS[name], se2.IDENTITY)
        b = map_of(log, scans[1], resolution_b, LOGS[name], T_b_log)
        return _with_truth(f"{name} {band} ({share:.0%})", a, b, se2.inverse(T_b_log))
    return None


def _finished_pair(name: str, a: OccupancyGrid, b: OccupancyGrid, random: np.random.Generator) -> MapPair:
    T_b_old = _random_frame(random)
    return _with_truth(name, a, _redrawn(b, T_b_old), se2.inverse(T_b_old))


def _with_truth(name: str, a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> MapPair:
    points_b = common_free_points(a, b, T_a_b)
    return MapPair(name, a, b, PairTruth(T_a_b, se2.transform_points(T_a_b, points_b), points_b))


def _halmstad_pair(folder: Path, first: str, second: str, random: np.random.Generator) -> MapPair:
    """Return a pair of warped maps; right is what comes within 15 px and 5 deg of the best rigid fit."""
    marked = halmstad_points(folder, first, second)
    T_b_old = _random_frame(random)
    truth = PairTruth(
        se2.compose(marked.T_a_b, se2.inverse(T_b_old)),
        marked.points_a,
        se2.transform_points(T_b_old, marked.points_b),
        marked.residual_m + _HALMSTAD_PX * HALMSTAD_M_PER_PX[first.split("_", maxsplit=1)[0]],
        _HALMSTAD_DEG,
    )
    b = _redrawn(_halmstad(folder, second), T_b_old)
    return MapPair(f"Halmstad {first}/{second}", _halmstad(folder, first), b, truth)


def _places(data: Path) -> dict[str, OccupancyGrid]:
    """Return maps of buildings that are all different, logs and finished maps in turn."""
    windows = {}
    for name, reach_m in LOGS.items():
        log = _log(data, name)
        scans = np.flatnonzero(log.travelled_m <= max(60.0, 0.4 * log.travelled_m[-1]))
        windows[name] = map_of(log, scans, 0.05, reach_m, se2.IDENTITY)
    halmstad = data / "maps_halmstad"
    return {
        "belgioioso": windows["belgioioso"],
        "Halmstad F5": _halmstad(halmstad, "F5_01"),
        "csail": windows["csail"],
        "freiburg-079": _growing(data, 15),
        "fhw": windows["fhw"],
        "intel-lab": read_map(data / "maps_planning/intel-lab.yaml"),
        "freiburg-101": windows["freiburg-101"],
        "AAF 2016": read_map(data / "maps_strands/aaf_deployment16-cropped.yaml"),
        "edmonton": windows["edmonton"],
        "Halmstad HIH": _halmstad(halmstad, "HIH_01"),
        "Halmstad KPT4A": _halmstad(halmstad, "KPT4A_01"),
        "olin ac109": read_map(data / "maps_olin_ac109/ac109_1.yaml"),
    }


def _growing(data: Path, number: int) -> OccupancyGrid:
    return read_map(data / f"maps_freiburg079_incremental/map{number}.yaml")


def _halmstad(folder: Path, name: str) -> OccupancyGrid:
    building = name.split("_", maxsplit=1)[0]
    return read_picture_map(folder / f"maps/{building}/pseudo_occupancy/{name}.png", HALMSTAD_M_PER_PX[building])


@cache
def _log(data: Path, name: str) -> CorrectedLog:
    return read_corrected_log(data / f"carmen_ple/{name}-corrected.log.gz")


def _redrawn(grid: OccupancyGrid, T_new_old: FloatArray) -> OccupancyGrid:
    """Return the map in another frame, in which its own has the pose T_new_old (3,)."""
    raster = raster_around(se2.transform_points(T_new_old, known_corners(grid)), grid.resolution_m)
    return OccupancyGrid(resample(grid, T_new_old, raster), grid.resolution_m, raster.origin)


def _random_frame(random: np.random.Generator) -> FloatArray:
    return np.array([*random.uniform(-20.0, 20.0, 2), random.uniform(-np.pi, np.pi)])


def _common_free(a: OccupancyGrid, b: OccupancyGrid) -> tuple[float, float]:
    """Return the free space that two maps of one frame share, in m^2 and as a share of the smaller one's."""
    seen = resample(a, se2.IDENTITY, raster_of(b)) < 0.0
    smaller = min(np.count_nonzero(grid.log_odds < 0.0) for grid in (a, b))
    common = np.count_nonzero(seen & (b.log_odds < 0.0))
    return common * b.resolution_m**2, common / smaller if smaller else 0.0
