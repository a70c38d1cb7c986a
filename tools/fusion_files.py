"""What `fuse` leaves in its folder: a global map a group with its robots, the tree of the levels, and report.json."""

from __future__ import annotations

import json
import re
from pathlib import Path

from mapping.map_io import write_map
from tools.fused_groups import FusedGroups
from tools.map_files import MapFiles
from tools.merge_tree_picture import draw_tree
from tools.pictures import write_picture
from tools.result_folder import FUSED
from tools.results import Report, writing_to
from tools.robot_picture import draw_robots
from tools.robot_poses import FoundRobots, write_poses

TREE_NAME = "tree.png"
_GLOBAL = re.compile(r"global_(\d+)")


def save_fusion(folder: Path, loaded: MapFiles, fused: FusedGroups, robots: FoundRobots, report: Report) -> None:
    """Write the global maps, the robots' poses in them and, last, the report; each file is whole at any moment."""
    placed = list(robots.placed.values())
    with writing_to(folder):
        for k, group in enumerate(fused.groups):
            sources = [entry["file"] for entry in report["maps"] if entry["group"] == k]
            grid = group.cells.grid()
            write_map(folder / f"global_{k}", grid, provenance={"source": " + ".join(sorted(sources))})
            inside = [(robot.track.robot, robot.trajectory.poses) for robot in placed if robot.group == k]
            write_picture(folder / f"global_{k}.png", draw_robots(grid, inside))
        write_poses(folder, placed)
        if fused.merged:
            write_picture(folder / TREE_NAME, draw_tree(fused.merged, loaded.short_titles()))
        partial = folder / "report.json.part"
        partial.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
        partial.replace(folder / "report.json")


def remove_outdated(folder: Path, fused: FusedGroups, robots: FoundRobots) -> None:
    """Remove the global maps of an earlier result that are no more, and poses of robots that are no longer in them."""
    poses = {each.file_name for each in robots.placed.values()}
    with writing_to(folder):
        for file in folder.iterdir():
            number = _GLOBAL.match(file.name)
            if number is None or not FUSED.fullmatch(file.name):
                continue
            if int(number[1]) >= len(fused.groups) or (file.suffix == ".tum" and file.name not in poses):
                file.unlink()
