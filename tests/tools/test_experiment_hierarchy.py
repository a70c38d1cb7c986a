"""Figures 5.5 and 5.6: robots' maps into one."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import cv2
import pytest

from tools import experiment_hierarchy
from tools.experiment import ExperimentSettings

SETTINGS = ExperimentSettings(1, 0, 1)


@pytest.fixture(scope="module")
def folder(rooms_pairs, tmp_path_factory):
    """A folder of finished rows, among them the registrations by the default method."""
    folder = tmp_path_factory.mktemp("rows")
    (folder / experiment_hierarchy.FUSED_FOLDER / "default").mkdir(parents=True)
    shutil.copy(rooms_pairs, folder / experiment_hierarchy.FUSED_FOLDER / "default")
    return folder


@pytest.fixture(scope="module")
def hierarchy(rooms_set, folder):
    return experiment_hierarchy.run(rooms_set, SETTINGS, folder / "5.5-5.6")


def test_the_default_method_connects_all_and_says_how_far_each_is_off(hierarchy):
    default = hierarchy.json["default"]
    assert default["group_sizes"] == [3]
    assert default["worst"][0] < 0.1
    assert [each["right"] for each in default["maps"]] == [True, True, True]
    row = hierarchy.tables[0].rows[-1]
    assert row[1] == "3"
    assert row[4] == "0"
    json.dumps(hierarchy.json)


def test_the_order_of_merging_is_told(hierarchy):
    order = next(table for table in hierarchy.tables if table.title.startswith("Order of merging"))
    assert [row[0] for row in order.rows] == ["1", "2"]
    assert order.rows[0][1].count("{") == 2
    assert all(name in order.rows[1][1] for name in ("west", "mid", "east"))


def test_pictures_of_local_maps_of_the_tree_and_of_the_robots(hierarchy, tmp_path):
    assert len(hierarchy.pictures) == 3
    for number, picture in enumerate(hierarchy.pictures):
        picture.draw(tmp_path / f"{number}.png")
        assert cv2.imread(str(tmp_path / f"{number}.png")).std() > 5.0
        assert "Simulated" in picture.caption


def test_a_set_may_lack_robots_but_need_not_know_the_truth(rooms_set, box_set):
    assert "robots" in str(experiment_hierarchy.lacks(box_set))
    unknown = tuple(replace(each, pose=None) for each in rooms_set.maps)
    assert experiment_hierarchy.lacks(replace(rooms_set, maps=unknown)) is None
