"""A data set's maps fused, and how far each is from where it truly is in its group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fusion.evaluation import error_at_points
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.group_fusion import fuse_maps
from tools.map_data_set import DataSetMap, MapDataSet
from tools.merging_methods import METHODS
from tools.pair_files import RIGHT_DEG, RIGHT_M
from tools.results import FloatArray, Report

_WARPED_DEG, _WARPED_PX = 5.0, 15.0  # as for the tablet maps of docs/map_pairs.md
_SAMPLE = 4000


@dataclass(frozen=True, slots=True, eq=False)
class MapInGroup:
    """A map, its group, its pose (3,) there, and its error: rms over free cells in m, and deg; None without truth."""

    map: DataSetMap
    group: int
    T_global_map: FloatArray
    error_m: float | None
    error_deg: float | None
    right: bool | None


@dataclass(frozen=True, slots=True, eq=False)
class FusedSet:
    """The folder and report of `fuse` on a set's maps, by one method."""

    folder: Path
    report: Report
    maps: Sequence[MapInGroup]

    @property
    def group_sizes(self) -> list[int]:
        """How many maps each group has, the largest first."""
        groups = [each.group for each in self.maps]
        return sorted((groups.count(group) for group in {*groups}), reverse=True)

    def worst(self) -> tuple[float, float] | None:
        """Return the error in m and that in deg of the worst merged maps; None without any, or without a truth."""
        groups = [each.group for each in self.maps]
        merged = [each for each in self.maps if groups.count(each.group) > 1]
        errors = [(each.error_m, each.error_deg) for each in merged if each.error_m is not None]
        return (max(m for m, _ in errors), max(deg or 0.0 for _, deg in errors)) if errors else None


def is_several(data: MapDataSet) -> bool:
    """Whether a set has three maps or more, each of another robot: what merging in levels needs."""
    robots = [each.robot or each.name for each in data.maps]
    return len(robots) >= 3 and len({*robots}) == len(robots)


def fuse_set(data: MapDataSet, method: str, seed: int, jobs: int, folder: Path) -> FusedSet:
    """Fuse the maps of a set as `fuse` does; finished pairs are kept in the folder. Raises ToolError, MapFileError."""
    registration = replace(METHODS[method].registration, seed=seed)
    _, report = fuse_maps([each.path for each in data.maps], folder, registration, jobs)
    placed = [
        (each, int(entry["group"]), np.array(entry["T_global_map"]))
        for each, entry in zip(data.maps, report["maps"], strict=True)
        if entry["group"] is not None
    ]
    maps = []
    for each, group, pose in placed:
        reference, T_global_reference = next((m, T) for m, k, T in placed if k == group and not np.any(T))
        maps.append(_scored(each, group, pose, reference, se2.between(T_global_reference, pose)))
    return FusedSet(folder, report, maps)


def _scored(each: DataSetMap, group: int, pose: FloatArray, reference: DataSetMap, found: FloatArray) -> MapInGroup:
    """Compare the pose of a map in its group's reference with the truth."""
    if each.pose is None or reference.pose is None:
        return MapInGroup(each, group, pose, None, None, None)
    true = se2.between(reference.pose, each.pose)
    points = _free_points(read_map(each.path))
    error = error_at_points(se2.transform_points(true, points), points, found, true)
    warp_m = each.warp_m + reference.warp_m
    most_m, most_deg = RIGHT_M, RIGHT_DEG
    if warp_m > 0.0:
        most_m, most_deg = warp_m + _WARPED_PX * each.resolution_m, _WARPED_DEG
    right = error.rms_m <= most_m and error.rotation_deg <= most_deg
    return MapInGroup(each, group, pose, error.rms_m, error.rotation_deg, right)


def _free_points(grid: OccupancyGrid) -> FloatArray:
    """Return centres (N, 2) of free cells, of known ones where none is free, spread evenly."""
    rows, cols = np.nonzero(grid.free if grid.free.any() else grid.known)
    some = np.linspace(0, len(rows) - 1, min(len(rows), _SAMPLE)).astype(np.intp)
    return grid.cell_centers(rows[some], cols[some])
