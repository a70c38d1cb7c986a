"""Data set of kind parts: two parts of a building that overlap, each at several resolutions (thesis table 5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapping import se2
from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError
from tools.log_windows import BAND_LIMITS, PosedScans, WindowPair, draw_windows, map_of
from tools.map_data_set import MapDataSet
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.part_maps import DrivePart, start_frame, write_part
from tools.recorded_pairs import Drive, read_drive

CELLS_PER_METER = (10.0, 20.0, 25.0)
_WINDOWS, _JUDGED_M = 8, 0.1


def overlapping_parts(drives: Sequence[Drive], plan: DataSetPlan, folder: Path) -> MapDataSet:
    """Cut two windows of a drive with the wanted overlap of free space, of eight those that share most wall.

    Raises ToolError where no two windows overlap so.
    """
    (drive,) = drives
    scans = read_drive(drive)
    random = np.random.default_rng([plan.seed, *scans.building.encode()])
    windows = [each for each in draw_windows(scans, _WINDOWS, 0, random) if each.band == plan.overlap]
    if not windows:
        low, high = BAND_LIMITS[plan.overlap]
        raise ToolError(
            f"{drive.source}: no two windows of it share {low:.0%} to {min(high, 1.0):.0%} of their free space: "
            f"give a longer log, or another --overlap"
        )
    wall_m, share, window = max((_shared(scans, each) for each in windows), key=lambda each: each[0])
    every = 2 if window.shared else 1
    maps = []
    for robot, numbers in (("a", window.first), ("b", window.second)):
        part = DrivePart(robot, numbers, every, start_frame(scans.poses[numbers[0]], random))
        resolutions = plan.cells_per_meter or CELLS_PER_METER
        maps += [write_part(folder, scans, part, each, drive.source.name) for each in resolutions]
    halves = ", even scans in the one and odd ones in the other where they overlap on the way" * window.shared
    sentence = (
        f"{'Simulated' if scans.simulated else 'Real'} data: {drive.source.name}, two windows of "
        f"{len(window.first)} and {len(window.second)} scans{halves}; they share {share:.0%} of the smaller's free "
        f"space and {wall_m:.0f} m of wall, the most of {len(windows)} random pairs of {plan.overlap} overlap; "
        f"{drive.truth_in_words} are the truth, so a bend of the log is common to both."
    )
    return MapDataSet(folder, scans.building, sentence, scans.simulated, tuple(maps))


def _shared(scans: PosedScans, window: WindowPair) -> tuple[float, float, WindowPair]:
    """Return the metres of wall and the share of free space that two windows have in common."""
    a, b = (map_of(scans, numbers, _JUDGED_M, se2.IDENTITY) for numbers in (window.first, window.second))
    wall_m = common_wall_m(wall_line(a), wall_line(b), se2.IDENTITY)
    return wall_m, common_free(a, b, se2.IDENTITY).share, window
