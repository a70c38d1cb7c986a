"""What is left in the folder of `fuse` where it writes again and again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fusion.map_set import MapSet
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.trajectory import Trajectory, read_tum
from tools.fused_groups import FusedGroups, global_maps
from tools.fusion_files import remove_outdated, save_fusion
from tools.map_files import MapFiles
from tools.robot_poses import FoundRobots, RobotTrack, place

GRID = OccupancyGrid(np.full((20, 20), -2.0, np.float32), 0.05, np.zeros(3))
MAPS = MapSet().added({"a": GRID})
FUSED = FusedGroups(global_maps(MAPS, MAPS.structure()), {})
LOADED = MapFiles([Path("a.npz")], {0: GRID}, {}, {"a": GRID}, {0: "a"})
REPORT = {"maps": [{"file": "a.npz", "group": 0}]}


@pytest.fixture
def robots():
    drive = Trajectory(np.array([1, 2], np.int64), np.array([[0.1, 0.1, 0.0], [0.8, 0.5, 1.0]]))
    track = RobotTrack("a", 0, Path("a.tum"), drive)
    return FoundRobots([track], {"a": place(track, 0, (np.zeros(3), np.zeros(3)), None)})


def test_map_picture_poses_and_report_are_written_and_nothing_else_is_left(robots, tmp_path):
    save_fusion(tmp_path, LOADED, FUSED, robots, REPORT)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"global_0.yaml", "global_0.pgm", "global_0.npz", "global_0.png", "global_0_a.tum", "report.json"}
    np.testing.assert_array_equal(read_map(tmp_path / "global_0.npz").log_odds.max(), -2.0)
    assert len(read_tum(tmp_path / "global_0_a.tum")) == 2
    assert json.loads((tmp_path / "report.json").read_text()) == REPORT


def test_what_an_earlier_result_had_more_goes_and_what_is_not_ours_stays(robots, tmp_path):
    save_fusion(tmp_path, LOADED, FUSED, robots, REPORT)
    for name in (
        "global_1.yaml",
        "global_1.png",
        "global_0_b.tum",
        "global_1_a.tum",
        "notes.txt",
        "global_warm.txt",
    ):
        (tmp_path / name).write_text("x")
    remove_outdated(tmp_path, FUSED, robots)
    assert {path.name for path in tmp_path.iterdir()} == {
        "global_0.yaml", "global_0.pgm", "global_0.npz", "global_0.png", "global_0_a.tum", "report.json",
        "notes.txt", "global_warm.txt",
    }  # fmt: skip
