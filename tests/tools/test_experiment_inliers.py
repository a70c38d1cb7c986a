"""Experiments 4.5 and 4.6: matrices of inliers between resolutions."""

from __future__ import annotations

import math

import cv2
import pytest

from fusion.features import FeatureMethod
from tools.experiment import ExperimentSettings
from tools.experiment_inliers import inlier_count, inlier_precision, is_right, matches_to
from tools.matched_images import Match


@pytest.fixture(scope="module")
def outcomes(box_set, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rows")
    settings = ExperimentSettings(1, 0, 1)
    return [run(box_set, settings, folder / name) for run, name in ((inlier_precision, "4.5"), (inlier_count, "4.6"))]


def test_a_map_with_itself_has_only_inliers(outcomes):
    precision, count = outcomes
    for outcome, diagonal in ((precision, {"1.00"}), (count, None)):
        table = next(table for table in outcome.tables if table.title == "KAZE, rigid (method 1), O^free, alpha 0.99")
        assert [row[0] for row in table.rows] == ["10", "20"]
        own = {table.rows[number][1 + number] for number in range(2)}
        assert own == diagonal or min(map(int, own)) > 50


def test_both_show_the_same_matches_and_are_computed_once(outcomes):
    assert outcomes[0].json == outcomes[1].json


def test_each_cell_is_the_matching_of_two_maps(box_set, outcomes):
    fixed, moving = box_set.maps[1], box_set.maps[0]
    again = matches_to((moving, fixed), fixed, None, FeatureMethod("sift"), 0)
    row = outcomes[0].json["matches"]["O, sift, to r20-k1"]
    for model in ("rigid", "similarity"):
        for key in ("matches", "inliers", "turn_rad", "scale"):
            assert row[f"{model}, r10-k1"][key] == again[f"{model}, r10-k1"][key]


def test_the_summary_counts_pairs_of_two_resolutions_only(outcomes):
    row = outcomes[0].tables[0].rows[0]
    assert row[:4] == ["O", "KAZE", "similarity", "no"]
    assert row[-1].endswith("of 2")


@pytest.mark.parametrize(
    ("turn_deg", "scale", "right"), [(0.0, 2.0, True), (-4.9, 2.05, True), (5.1, 2.0, False), (0.0, 1.8, False)]
)
def test_a_motion_is_right_by_its_turn_and_scale(turn_deg, scale, right):
    assert is_right(Match(10, 5, math.radians(turn_deg), scale, 0.1), 2.0) is right
    assert not is_right(Match(10, 0, None, None, 0.1), 2.0)


def test_turned_maps_are_matched_too(outcomes):
    table = outcomes[0].tables[1]
    assert len(table.rows) == 2 * 3 * 2 * 2
    by_key = {tuple(row[:4]): [float(text) for text in row[4:7]] for row in table.rows}
    for (image, features, turn, limit), (keypoints, matches, inliers) in by_key.items():
        assert inliers <= matches <= keypoints
        if limit == "yes":
            assert matches <= by_key[image, features, turn, "no"][1]
    straight, turned = (by_key["O", "KAZE", turn, "no"] for turn in ("0 deg", "31 deg"))
    assert straight != turned
    assert min(straight[2], turned[2]) > 10


def test_the_picture_is_drawn(outcomes, tmp_path):
    picture = outcomes[1].pictures[0]
    picture.draw(tmp_path / "x.png")
    assert cv2.imread(str(tmp_path / "x.png")).std() > 5.0
    assert "SIMULATED" in picture.draw.keywords["title"]
