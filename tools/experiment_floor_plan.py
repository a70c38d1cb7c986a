"""Figure 5.7: the global map on the building's floor plan."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from fusion.resampling import known_corners
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.metrics import align_points
from tools.experiment import Experiment, ExperimentSettings, Picture, Table
from tools.experiment_hierarchy import fused_by
from tools.floor_plan import distance_m, plan_lines
from tools.fused_set import FusedSet, is_several
from tools.local_maps_picture import placed_on_plan
from tools.map_data_set import FloorPlan, MapDataSet
from tools.pictures import write_picture
from tools.placed_maps_picture import PlacedMap
from tools.results import FloatArray, Report
from tools.robot_picture import robot_color

_COLUMNS = (
    "group",
    "maps",
    "wrong",
    "worst map, m",
    "worst map, deg",
    "walls within 0.3 m of the plan, %",
    "median, m",
)
_NOTE = (
    "A global map lies where its maps' true poses, each equally, put it (rigid, with no scale of its own): by "
    "hand-made marks, not by fitting walls to the plan. Walls: occupied cells near a line of it; furniture has none."
)
_NEAR_M = 0.3


def lacks(data: MapDataSet) -> str | None:
    """Return what a set lacks: maps of several robots with true poses, and a floor plan with scale and pose."""
    plan = data.floor_plan
    if plan is None or plan.resolution_m is None or plan.pose is None:
        return "no floor plan with its scale and pose: make a set of the kind halmstad"
    if not is_several(data) or any(each.pose is None for each in data.maps):
        return "not three or more maps with true poses, each of another robot: make a set of the kind halmstad"
    return None


def run(data: MapDataSet, settings: ExperimentSettings, folder: Path) -> Experiment:
    """Fuse all maps by the default method and lay each global map of two maps or more on the plan."""
    plan = data.floor_plan
    assert plan is not None, "lacks() asks for a plan"
    fused = fused_by(data, "default", settings, folder)
    groups = [k for k in sorted({each.group for each in fused.maps}) if _members(fused, k) > 1]
    placed = {k: (read_map(fused.folder / f"global_{k}.npz"), plan_pose(fused, k)) for k in groups}
    rows, figures = [], list[Report]()
    for k, (grid, T_set_global) in placed.items():
        near, median_m = _on_plan(grid, T_set_global, plan)
        mine = [each for each in fused.maps if each.group == k]
        wrong = sum(each.right is False for each in mine)
        worst_m, worst_deg = (
            max(value or 0.0 for value in values)
            for values in zip(*((each.error_m, each.error_deg) for each in mine), strict=True)
        )
        rows.append(
            [
                str(k),
                str(len(mine)),
                str(wrong),
                f"{worst_m:.2f}",
                f"{worst_deg:.1f}",
                f"{100.0 * near:.0f}",
                f"{median_m:.2f}",
            ]
        )
        figures.append(
            {
                "group": k,
                "maps": [each.map.name for each in mine],
                "wrong": wrong,
                "worst_m": worst_m,
                "worst_deg": worst_deg,
                "near_plan": near,
                "median_m": median_m,
                "T_set_global": T_set_global.tolist(),
            }
        )
    alone = sum(size == 1 for size in fused.group_sizes)
    remarks = [f"{alone} of {len(fused.maps)} maps were merged with none."] if alone else []
    data_kind = "simulated" if data.simulated else "real"
    caption = f"The global map by the default method on the floor plan (figure 5.7), {data_kind} data."
    pictures = [Picture(caption, partial(_draw, placed=placed, plan=plan))] if placed else []
    table = Table(f"Global maps of {len(fused.maps)} maps on the plan", _COLUMNS, rows, _NOTE)
    return Experiment([table], pictures, {"groups": figures, "group_sizes": fused.group_sizes}, remarks)


def plan_pose(fused: FusedSet, group: int) -> FloatArray:
    """Return the pose (3,) of a group's frame in the set's at which its maps are nearest to their true poses."""
    in_group, in_set = [], []
    for each in fused.maps:
        if each.group == group and each.map.pose is not None:
            corners = known_corners(read_map(each.map.path))
            in_group.append(se2.transform_points(each.T_global_map, corners))
            in_set.append(se2.transform_points(each.map.pose, corners))
    return align_points(np.vstack(in_set), np.vstack(in_group))


def _members(fused: FusedSet, group: int) -> int:
    return sum(each.group == group for each in fused.maps)


def _on_plan(grid: OccupancyGrid, T_set_global: FloatArray, plan: FloorPlan) -> tuple[float, float]:
    """Return the share of the walls near a line of the plan, and the median distance in m."""
    assert plan.resolution_m is not None
    walls = se2.transform_points(T_set_global, grid.cell_centers(*np.nonzero(grid.occupied)))
    apart_m = distance_m(walls, plan_lines(plan), plan.resolution_m)
    return float((apart_m <= _NEAR_M).mean()), float(np.median(apart_m))


def _draw(file: Path, placed: dict[int, tuple[OccupancyGrid, FloatArray]], plan: FloorPlan) -> None:
    maps = [PlacedMap(grid, pose, robot_color(k + 1)) for k, (grid, pose) in placed.items()]
    labels = [(f"global map {k}", robot_color(k + 1)) for k in placed]
    write_picture(file, placed_on_plan(maps, labels, plan))
