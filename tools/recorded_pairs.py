"""Map pairs from any drive with poses: a corrected CARMEN log, or a recording and the trajectory of its replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.recording_reader import open_recording
from mapping import se2
from mapping.map_io import read_map
from mapping.map_yaml import read_map_yaml
from tools.driven_log import read_driven_log
from tools.errors import ToolError
from tools.log_windows import PosedScans, thinned
from tools.other_buildings import FINISHED, FIRST, BuildingMap, maps_of_pairs, varied_pairs
from tools.pair_files import MapPair
from tools.pair_making import WindowPlan, copy_map, window_pairs, write_scale_map
from tools.processes import in_processes
from tools.real_maps import LOG_REACH_M, read_corrected_log
from tools.replay_run import recorded_config

FloatArray = NDArray[np.float64]
_REACH_M = 15.0
_SHIFT_M = 20.0


@dataclass(frozen=True, slots=True)
class Drive:
    """A log that holds its poses, or a recording with the trajectory.tum that `replay` wrote of it.

    building: what it was driven in; None: named as the file. Drives of one building are no pairs of two buildings.
    """

    source: Path
    trajectory: Path | None = None
    building: str | None = None

    @property
    def truth_in_words(self) -> str:
        """Whose poses are taken for the truth."""
        return "the log's own poses" if self.trajectory is None else f"the poses of {self.trajectory.name}"


def read_drive(drive: Drive, *, thin: bool = True) -> PosedScans:
    """Read scans and poses; raises ToolError and the reader's own errors where either is missing.

    Of a recording's scans one is taken each 0.1 m or 5 deg of motion, or with thin=False all. Named as the file,
    whatever the building.
    """
    if drive.trajectory is None:
        name = drive.source.name.split(".", maxsplit=1)[0].removesuffix("-corrected")
        return read_corrected_log(drive.source, LOG_REACH_M.get(name, _REACH_M))
    with open_recording(drive.source) as recording:
        config = recorded_config(recording)
        simulated = recording.metadata.get("mapfuse.origin", {}).get("simulated") == "true"
    log = read_driven_log(drive.source, drive.trajectory, config)
    at_sensor = np.array([*log.sensor, 0.0])
    points = tuple(each - log.sensor for each in log.points)
    packed = drive.source.suffix in {".gz", ".bz2"}
    source = drive.source.with_suffix("") if packed else drive.source
    duration_s = float(np.ptp(log.stamps_ns)) * 1e-9
    poses = se2.compose(log.poses, at_sensor)
    scans = PosedScans(source.stem, poses, points, config.grid.max_range_m, duration_s, simulated, log.stamps_ns)
    return thinned(scans) if thin else scans


def drive_pairs(
    folder: Path, drives: Sequence[Drive], plan: WindowPlan, seed: int, jobs: int
) -> Iterator[tuple[str, list[MapPair]]]:
    """Yield the building and the pairs of each drive, with maps below the folder: same drives and seed, same pairs.

    jobs: processes. Raises ToolError where a drive is too short for windows, or none of them fit.
    """
    return in_processes(partial(_pairs_of_drive, folder, plan, seed), drives, jobs=jobs)


def recorded_pairs(
    folder: Path,
    drives: Sequence[Drive],
    plan: WindowPlan,
    others: Sequence[Path],
    seed: int,
    jobs: int,
    on_progress: Callable[[str], None],
) -> list[MapPair]:
    """Return the pairs of drives, and of each drive's maps with others, maps of other buildings, plan.apart of them."""
    random = np.random.default_rng(seed)
    finished = [_copied(folder, number, path, random) for number, path in enumerate(others)]
    pairs: list[MapPair] = []
    for building, found in drive_pairs(folder, drives, plan, seed, jobs):
        true = sum(pair.truth is not None for pair in found)
        on_progress(f"{building}: {true} true pairs, {len(found) - true} of places apart")
        firsts = [each for each in maps_of_pairs(found) if each.kind == FIRST]
        pairs += [*found, *varied_pairs(firsts, finished, plan.apart if finished else 0, random, set())]
    return pairs


def _pairs_of_drive(folder: Path, plan: WindowPlan, seed: int, drive: Drive) -> tuple[str, list[MapPair]]:
    scans = read_drive(drive)
    pairs = window_pairs(folder, scans, plan, seed)
    if not pairs:
        raise ToolError(f"{drive.source}: no two windows of it overlap as wanted: take a longer log, or more windows")
    building = drive.building or scans.building
    return building, [replace(pair, building_a=building, building_b=building) for pair in pairs]


def _copied(folder: Path, number: int, path: Path, random: np.random.Generator) -> BuildingMap:
    """Copy a finished map with a random origin."""
    stem, shift_m = folder / f"other-{number:02d}-{path.stem}", random.uniform(-_SHIFT_M, _SHIFT_M, 2)
    if path.suffix.lower() == ".npz":
        grid = read_map(path)
        moved = replace(grid, origin=grid.origin + np.array([*shift_m, 0.0]))
        return BuildingMap(path.stem, write_scale_map(stem, moved), FINISHED, grid.resolution_m)
    settings = read_map_yaml(path)
    read_map(path)  # an image that cannot be read fails here, not at the first evaluation
    return BuildingMap(path.stem, copy_map(stem, settings.image, settings, shift_m), FINISHED, settings.resolution_m)
