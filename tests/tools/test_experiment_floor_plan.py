"""Figure 5.7: the global map on the floor plan."""

from __future__ import annotations

import shutil
from dataclasses import replace

import cv2
import numpy as np

from mapping import se2
from tools.experiment import ExperimentSettings
from tools.experiment_floor_plan import lacks, plan_pose, run
from tools.experiment_hierarchy import FUSED_FOLDER
from tools.fused_set import fuse_set


def test_the_global_map_lies_on_the_plan(rooms_set, rooms_pairs, tmp_path):
    (tmp_path / FUSED_FOLDER / "default").mkdir(parents=True)
    shutil.copy(rooms_pairs, tmp_path / FUSED_FOLDER / "default")
    outcome = run(rooms_set, ExperimentSettings(1, 0, 1), tmp_path / "5.7")
    (group,) = outcome.json["groups"]
    assert (len(group["maps"]), group["wrong"]) == (3, 0)
    assert group["near_plan"] > 0.97
    assert group["median_m"] < 0.08
    outcome.pictures[0].draw(tmp_path / "a.png")
    assert cv2.imread(str(tmp_path / "a.png")).std() > 5.0
    assert "simulated" in outcome.pictures[0].caption


def test_a_group_lies_where_the_truth_of_its_maps_puts_it(rooms_set, rooms_pairs, tmp_path):
    shutil.copy(rooms_pairs, tmp_path)
    by = np.array([5.0, -2.0, 0.9])
    moved = replace(rooms_set, maps=tuple(replace(m, pose=se2.compose(by, m.pose)) for m in rooms_set.maps))
    poses = [plan_pose(fuse_set(data, "default", 0, 1, tmp_path), 0) for data in (rooms_set, moved)]
    np.testing.assert_allclose(se2.compose(by, poses[0]), poses[1], atol=1e-6)


def test_a_set_may_lack_the_plan_or_the_truth(rooms_set):
    assert lacks(rooms_set) is None
    assert "floor plan" in str(lacks(replace(rooms_set, floor_plan=None)))
    assert "floor plan" in str(lacks(replace(rooms_set, floor_plan=replace(rooms_set.floor_plan, pose=None))))
    unknown = tuple(replace(each, pose=None) for each in rooms_set.maps)
    assert "true poses" in str(lacks(replace(rooms_set, maps=unknown)))
