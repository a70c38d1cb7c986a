"""Data set of kind growing: the maps of two robots while they drive, one of each for every step (thesis section 5.4).

Of one drive: two parts of it, driven at the same time, that share little until late, in random frames. Of two drives of
different buildings: a part of each; they have nothing in common, and no map has a true pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.map_io import write_lossless
from mapping.sensor_models import LidarModel
from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError, UsageError
from tools.log_windows import PosedScans
from tools.map_data_set import DataSetMap, MapDataSet
from tools.pair_making import random_frame
from tools.pair_overlap import common_free
from tools.recorded_pairs import Drive, read_drive

FloatArray = NDArray[np.float64]
ScanNumbers = NDArray[np.intp]
ROBOTS = ("a", "b")
STEP_M, CELLS_PER_METER = 2.5, 20.0
_SPAN_M, _SPAN_SHARE = (40.0, 100.0), 0.4  # of a robot's part, and of the drive at most
_TRIES = 400
_COARSE_M = 0.2
_CHECKS = 10  # of a sequence, for when the overlap begins
_LATE = (0.4, 0.8)  # part of the way at which the maps first share _FIRST_M2 of free space
_FIRST_M2, _LAST_M2, _LAST_SHARE = 15.0, 60.0, 0.25


@dataclass(frozen=True, slots=True, eq=False)
class RobotPart:
    """A robot's part of a drive: scan numbers in the order in which it drives, and metres driven at each."""

    scans: PosedScans
    numbers: ScanNumbers
    driven_m: FloatArray

    def until(self, driven_m: float) -> int:
        """Return how many of its scans come within so many metres."""
        return int(np.searchsorted(self.driven_m, driven_m + 1e-9, side="right"))


def growing_maps(drives: Sequence[Drive], plan: DataSetPlan, folder: Path) -> MapDataSet:
    """Write the maps of two robots after every 2.5 m of way; raises ToolError where no such parts are found.

    plan.cells_per_meter: of both robots, or of a and b.
    """
    resolutions = plan.cells_per_meter or (CELLS_PER_METER,)
    if len(resolutions) > len(ROBOTS):
        raise UsageError(f"--cells-per-meter: {len(resolutions)} numbers for {len(ROBOTS)} robots: name one or two")
    every = (plan.scan_every or (1,))[0]
    scans = [read_drive(drive) for drive in drives]
    random = np.random.default_rng([plan.seed, *" ".join(each.building for each in scans).encode()])
    parts = late_parts(scans[0], random) if len(scans) == 1 else [any_part(each, random) for each in scans]
    maps: list[DataSetMap] = []
    for robot, part, r in zip(ROBOTS, parts, (*resolutions, resolutions[0])[: len(ROBOTS)], strict=True):
        T_map_log = random_frame(random)
        for step, grid in enumerate(versions(part, 1.0 / r, T_map_log, STEP_M, every), start=1):
            path = folder / "maps" / f"{robot}-{step:03d}.npz"
            write_lossless(path, grid, provenance={"source": part.scans.building, "robot": robot, "step": str(step)})
            pose = se2.inverse(T_map_log) if len(scans) == 1 else None
            maps.append(
                DataSetMap(path.stem, path, grid.resolution_m, scan_every=every, robot=robot, step=step, pose=pose)
            )
    simulated = any(each.simulated for each in scans)
    name = "-".join(dict.fromkeys(each.building for each in scans)) + f"-{plan.seed}"
    return MapDataSet(folder, name, _sentence(drives, parts, simulated=simulated), simulated, tuple(maps))


def late_parts(scans: PosedScans, random: np.random.Generator) -> list[RobotPart]:
    """Return two parts of one drive, either way along it, that begin to share free space late; raises ToolError.

    Where they overlap in travelled length one takes the even scans and the other the odd ones: no scan is in both.
    """
    length = float(scans.travelled_m[-1])
    most = min(_SPAN_M[1], _SPAN_SHARE * length)
    for _ in range(_TRIES if most > _SPAN_M[0] else 0):
        span = float(random.uniform(_SPAN_M[0], most))
        starts = random.uniform(0.0, length - span, 2)
        backwards = random.random(2) < 0.5
        shared = bool(abs(starts[0] - starts[1]) < span)
        parts = [
            _part(scans, start, span, backwards=bool(back), parity=number if shared else None)
            for number, (start, back) in enumerate(zip(starts.tolist(), backwards, strict=True))
        ]
        if _overlap_comes_late(parts, span):
            return parts
    raise ToolError(
        f"{scans.building}: {length:.0f} m driven, and no two parts of {_SPAN_M[0]:.0f} m or more whose overlap comes "
        f"late: take a longer log or another --seed"
    )


def any_part(scans: PosedScans, random: np.random.Generator) -> RobotPart:
    """Return a random part of a drive, either way along it; raises ToolError for a drive that is too short."""
    length = float(scans.travelled_m[-1])
    if length < _SPAN_M[0]:
        raise ToolError(f"{scans.building}: {length:.0f} m driven, {_SPAN_M[0]:.0f} m are needed: take a longer log")
    span = float(random.uniform(_SPAN_M[0], min(_SPAN_M[1], length)))
    return _part(scans, float(random.uniform(0.0, length - span)), span, backwards=bool(random.random() < 0.5))


def versions(
    part: RobotPart, resolution_m: float, T_map_log: FloatArray, step_m: float, every: int = 1
) -> Iterator[OccupancyGrid]:
    """Yield a robot's map after each step of its way, drawn in a frame in which the log's frame has pose T_map_log."""
    builder = GridBuilder(resolution_m, LidarModel(max_range_m=part.scans.reach_m, noise_fraction=0.0))
    drawn = 0
    for step in range(1, math.ceil(float(part.driven_m[-1]) / step_m) + 1):
        until = part.until(step * step_m)
        for place in range(drawn, until):
            if place % every == 0:
                number = int(part.numbers[place])
                pose = se2.compose(T_map_log, part.scans.poses[number])
                builder.add_scan(pose[:2], se2.transform_points(pose, part.scans.points[number]))
        drawn = until
        yield builder.grid()


def _part(scans: PosedScans, start: float, span: float, *, backwards: bool, parity: int | None = None) -> RobotPart:
    travelled = scans.travelled_m
    numbers = np.flatnonzero((travelled >= start) & (travelled <= start + span))
    if parity is not None:
        numbers = numbers[numbers % 2 == parity]
    if backwards:
        numbers = numbers[::-1]
    return RobotPart(scans, numbers, np.abs(travelled[numbers] - travelled[numbers[:1]]))


def _overlap_comes_late(parts: Sequence[RobotPart], span: float) -> bool:
    """Tell whether two parts begin to share free space in the wanted part of the way, and share enough at its end."""
    if any(len(part.numbers) < 2 * _CHECKS or part.driven_m[-1] < 0.9 * span for part in parts):
        return False
    step_m = span / _CHECKS
    stride = max(1, min(len(part.numbers) for part in parts) // 100)
    ways = (versions(part, _COARSE_M, se2.IDENTITY, step_m, stride) for part in parts)
    first, last = None, None
    for check, (a, b) in enumerate(zip(*ways, strict=False), start=1):
        last = common_free(a, b, se2.IDENTITY)
        if first is None and last.area_m2 >= _FIRST_M2:
            first = check / _CHECKS
            if not _LATE[0] <= first <= _LATE[1]:
                return False
    return first is not None and last is not None and last.area_m2 >= _LAST_M2 and last.share >= _LAST_SHARE


def _sentence(drives: Sequence[Drive], parts: Sequence[RobotPart], *, simulated: bool) -> str:
    kind = "Simulated" if simulated else "Real"
    lengths = " and ".join(f"{part.driven_m[-1]:.0f} m" for part in parts)
    names = " and ".join(drive.source.name for drive in drives)
    if len(drives) == 1:
        return (
            f"{kind} data: {names}, two parts of it of {lengths}, taken as two robots that drive at the same time; a "
            f"map of each every {STEP_M:g} m, drawn at the poses that come with the log, in random frames."
        )
    return (
        f"{kind} data: {names}, two buildings: a part of {lengths} of each, taken as two robots that drive at the same "
        f"time; a map of each every {STEP_M:g} m, in random frames. The maps have no place in common."
    )
