"""Windows of one drive, in twos: maps of one building whose relative pose is known, because one log holds both.

Where two windows overlap in travelled length the one takes the even scans and the other the odd ones: no scan is ever
in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.sensor_models import LidarModel
from tools.errors import ToolError
from tools.pair_overlap import common_free, free_area_m2

FloatArray = NDArray[np.float64]
ScanNumbers = NDArray[np.intp]
BAND_LIMITS = {"low": (0.15, 0.35), "mid": (0.35, 0.60), "high": (0.60, 1.01)}  # common free space / the smaller map's
_APART = 0.002
_COARSE_M = 0.2
_LEAST_FREE_M2, _LEAST_COMMON_M2 = 40.0, 15.0
_SHORTEST_M, _SHORTEST_SHARE, _LONGEST_M, _LONGEST_SHARE = 25.0, 0.08, 250.0, 0.45
TRIES = 3000
_SPARSE_M = 1.0  # between the scans that a window is judged by, where there are more
_CAMERA_REACH_M, _CAMERA_HALF_ANGLE_RAD, _CAMERA_NOISE = 5.0, np.radians(35.0), 0.003  # noise: sigma = that r^2


@dataclass(frozen=True, slots=True, eq=False)
class PosedScans:
    """A drive of N scans: poses (N, 3) of the sensor in the log's frame, and each one's points (K, 2) in the sensor's.

    Points beyond reach_m count as free space up to there. duration_s: from the first scan to the last, None unknown.
    stamps_ns (N,): rising strictly; None where the log's do not.
    """

    building: str
    poses: FloatArray
    points: tuple[FloatArray, ...]
    reach_m: float
    duration_s: float | None = None
    simulated: bool = False
    stamps_ns: NDArray[np.int64] | None = None

    @property
    def travelled_m(self) -> FloatArray:
        """(N,) metres driven at each scan."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.poses[:, :2], axis=0).T))])


@dataclass(frozen=True, slots=True, eq=False)
class WindowPair:
    """Numbers of the scans of two windows; band None: they share no free space. shared: they overlap on the way."""

    first: ScanNumbers
    second: ScanNumbers
    band: str | None
    shared: bool


def map_of(scans: PosedScans, numbers: ScanNumbers, resolution_m: float, T_map_log: FloatArray) -> OccupancyGrid:
    """Return the grid of some scans, drawn in a frame in which the log's frame has the pose T_map_log (3,)."""
    builder = GridBuilder(resolution_m, LidarModel(max_range_m=scans.reach_m, noise_fraction=0.0))
    for number in numbers.tolist():
        pose = se2.compose(T_map_log, scans.poses[number])
        builder.add_scan(pose[:2], se2.transform_points(pose, scans.points[number]))
    return builder.grid()


def as_camera(scans: PosedScans, random: np.random.Generator) -> PosedScans:
    """Return what a depth camera would have seen of it: 70 deg, 5 m, range noise that grows with the square."""
    seen = []
    for points in scans.points:
        ahead = points[np.abs(np.arctan2(points[:, 1], points[:, 0])) <= _CAMERA_HALF_ANGLE_RAD]
        ranges = np.maximum(np.hypot(ahead[:, 0], ahead[:, 1]), 1e-6)
        noise_m = _CAMERA_NOISE * np.minimum(ranges, _CAMERA_REACH_M) ** 2 * random.standard_normal(len(ranges))
        seen.append(ahead * (1.0 + noise_m / ranges)[:, np.newaxis])
    return replace(scans, points=tuple(seen), reach_m=_CAMERA_REACH_M)


def thinned(scans: PosedScans, step_m: float = 0.1, step_rad: float = math.radians(5.0)) -> PosedScans:
    """Return the scans that come after so much of motion, or turning, since the last that is returned."""
    kept = [0]
    for number in range(1, len(scans.poses)):
        moved = se2.between(scans.poses[kept[-1]], scans.poses[number])
        if math.hypot(moved[0], moved[1]) >= step_m or abs(moved[2]) >= step_rad:
            kept.append(number)
    stamps_ns = None if scans.stamps_ns is None else scans.stamps_ns[kept]
    points = tuple(scans.points[number] for number in kept)
    return replace(scans, poses=scans.poses[kept], points=points, stamps_ns=stamps_ns)


def draw_windows(
    scans: PosedScans, a_band: int, apart: int, random: np.random.Generator, tries: int = TRIES
) -> list[WindowPair]:
    """Return random window pairs: up to a_band for each band, at most half of them shared, and up to `apart` apart.

    Fewer where so many tries find no more. Raises ToolError where it is too short for two windows.
    """
    travelled = scans.travelled_m
    length = float(travelled[-1])
    low, high = max(_SHORTEST_M, _SHORTEST_SHARE * length), min(_LONGEST_SHARE * length, _LONGEST_M)
    if low > high:
        least = _SHORTEST_M / _LONGEST_SHARE
        raise ToolError(
            f"{scans.building}: {length:.0f} m driven, {least:.0f} m are needed for windows: take a longer log"
        )
    found: list[WindowPair] = []
    wanted: dict[str | None, int] = {None: apart}
    wanted.update(dict.fromkeys(BAND_LIMITS, a_band))
    shared_left = dict.fromkeys(BAND_LIMITS, a_band // 2)
    for _ in range(tries):
        spans = random.uniform(low, high, 2)
        starts = random.uniform(0.0, length - spans)
        shared = bool(starts.max() < (starts + spans).min())
        open_to_it = [band for band in wanted if wanted[band] and not (shared and not shared_left.get(band or "", 0))]
        if not open_to_it:
            continue
        pair = _judged(scans, _numbers(travelled, starts, spans, shared=shared), shared=shared)
        if pair is None or pair.band not in open_to_it:
            continue
        wanted[pair.band] -= 1
        if shared and pair.band is not None:
            shared_left[pair.band] -= 1
        found.append(pair)
    order: Sequence[str | None] = [*BAND_LIMITS, None]
    return sorted(found, key=lambda pair: order.index(pair.band))


def _numbers(travelled: FloatArray, starts: FloatArray, spans: FloatArray, *, shared: bool) -> list[ScanNumbers]:
    """Return the numbers of the scans in two windows, told by their starts (2,) and lengths (2,) in m."""
    numbers = [
        np.flatnonzero((travelled >= start) & (travelled < start + span))
        for start, span in zip(starts, spans, strict=True)
    ]
    return [each[each % 2 == parity] for parity, each in enumerate(numbers)] if shared else numbers


def _judged(scans: PosedScans, numbers: Sequence[ScanNumbers], *, shared: bool) -> WindowPair | None:
    """Return two windows with their band; None where they have too little free space, or an overlap between bands."""
    coarse = []
    spacing_m = float(scans.travelled_m[-1]) / len(scans.poses)
    stride = max(1, int(_SPARSE_M / max(spacing_m, 1e-3)))
    for each in numbers:
        coarse.append(map_of(scans, each[::stride], _COARSE_M, se2.IDENTITY))
        if free_area_m2(coarse[-1]) < _LEAST_FREE_M2:
            return None
    common = common_free(coarse[0], coarse[1], se2.IDENTITY)
    if common.share <= _APART:
        return WindowPair(numbers[0], numbers[1], None, shared)
    if common.area_m2 < _LEAST_COMMON_M2:
        return None
    band = next((name for name, (low, high) in BAND_LIMITS.items() if low <= common.share < high), None)
    return None if band is None else WindowPair(numbers[0], numbers[1], band, shared)
