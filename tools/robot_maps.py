"""Data set of kind robots: several robots map a building, each its part, as it can afford to (thesis section 5.5)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError
from tools.log_windows import PosedScans, ScanNumbers
from tools.map_data_set import MapDataSet
from tools.part_maps import DrivePart, start_frame, write_part
from tools.recorded_pairs import Drive, read_drive

CELLS_PER_METER = (25.0, 20.0, 12.5, 10.0, 20.0, 25.0)
SCAN_EVERY = (2, 4, 2, 6, 4, 2)
_LEAST_SCANS = 8


def robot_maps(drives: Sequence[Drive], plan: DataSetPlan, folder: Path) -> MapDataSet:
    """Cut a drive into a part a robot, each half in common with the next one; raises ToolError.

    Of n robots each drives 2 / (n + 1) of the way. Even scans make one part, odd ones the next, so that no scan is in
    two maps; of these each robot takes those of its own rate. Resolutions and rates are dealt out in turn.
    """
    (drive,) = drives
    scans = read_drive(drive)
    resolutions, every = plan.cells_per_meter or CELLS_PER_METER, plan.scan_every or SCAN_EVERY
    odd = [k for k in every if k % 2]
    if odd:
        raise ToolError(
            f"--scan-every {odd[0]}: parts that overlap share no scan: of the kind robots only even numbers"
        )
    random = np.random.default_rng([plan.seed, *scans.building.encode()])
    maps = []
    for robot in range(plan.robots):
        k = every[robot % len(every)]
        numbers = _numbers(scans, robot, plan.robots, k)
        if len(numbers) < _LEAST_SCANS:
            raise ToolError(
                f"{drive.source}: {len(numbers)} scans for robot {robot + 1} of {plan.robots}, {_LEAST_SCANS} are "
                f"needed: give a longer log, or lower --robots or --scan-every"
            )
        part = DrivePart(f"robot{robot + 1}", numbers, k, start_frame(scans.poses[numbers[0]], random))
        maps.append(write_part(folder, scans, part, resolutions[robot % len(resolutions)], drive.source.name))
    sentence = (
        f"{'Simulated' if scans.simulated else 'Real'} data: {drive.source.name}, {len(scans.poses)} scans over "
        f"{scans.travelled_m[-1]:.0f} m, cut into {plan.robots} parts of 2/{plan.robots + 1} of the way, each half in "
        f"common with the next one and no scan in two; {drive.truth_in_words} are the truth, so a bend of the "
        f"log is common to all parts."
    )
    return MapDataSet(folder, scans.building, sentence, scans.simulated, tuple(maps))


def _numbers(scans: PosedScans, robot: int, robots: int, every: int) -> ScanNumbers:
    """Return the numbers of the scans that a robot takes."""
    share = scans.travelled_m / max(float(scans.travelled_m[-1]), 1e-9) * (robots + 1)
    inside = np.flatnonzero((share >= robot) & (share <= robot + 2))
    return np.asarray(inside[inside % 2 == robot % 2][:: every // 2], dtype=np.intp)
