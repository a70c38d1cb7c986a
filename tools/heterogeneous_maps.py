"""Data set of kind heterogeneous: one environment at several resolutions and scan rates (thesis section 4.1.1)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mapping import se2
from mapping.map_io import write_map
from tools.data_set_plan import DataSetPlan
from tools.errors import ToolError
from tools.log_windows import map_of
from tools.map_data_set import DataSetMap, MapDataSet
from tools.recorded_pairs import Drive, read_drive

CELLS_PER_METER = (8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0)  # table 4.1
SCAN_EVERY = (1, 2, 3, 4)
_LEAST_SCANS = 10


def heterogeneous_maps(drives: Sequence[Drive], plan: DataSetPlan, folder: Path) -> MapDataSet:
    """Draw one drive at every resolution r from every k-th scan, all in one frame; raises ToolError.

    The poses are those of the drive, whatever the rate: maps differ in how many scans they are drawn from, and none
    fails as SLAM at a low rate may (`evaluate rates` maps anew at each rate).
    """
    (drive,) = drives
    scans = read_drive(drive, thin=False)
    every = plan.scan_every or SCAN_EVERY
    if len(scans.poses) < _LEAST_SCANS * max(every):
        raise ToolError(
            f"{drive.source}: {len(scans.poses)} scans, of which every {max(every)}th are too few for a map: "
            f"give a longer log, or lower --scan-every"
        )
    maps = []
    for k in every:
        numbers = np.arange(0, len(scans.poses), k)
        rate_hz = None if scans.duration_s is None else len(numbers) / scans.duration_s
        for r in plan.cells_per_meter or CELLS_PER_METER:
            grid = map_of(scans, numbers, 1.0 / r, se2.IDENTITY)
            name = f"r{r:g}-k{k}"
            source = {"source": drive.source.name, "scan_every": str(k), "cells_per_meter": f"{r:g}"}
            files = write_map(folder / "maps" / name, grid, provenance=source)
            maps.append(
                DataSetMap(
                    name, files.lossless, grid.resolution_m, rate_hz, k, scans.building, pose=np.array(se2.IDENTITY)
                )
            )
    label, length_m = "Simulated" if scans.simulated else "Real", scans.travelled_m[-1]
    sentence = (
        f"{label} data: {drive.source.name}, {len(scans.poses)} scans over {length_m:.0f} m, drawn at the poses that "
        f"come with it; maps of every k-th scan, k = {', '.join(map(str, every))}."
    )
    return MapDataSet(folder, scans.building, sentence, scans.simulated, tuple(maps))
