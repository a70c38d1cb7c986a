"""Figure 5.3: merges with one fixed map."""

from __future__ import annotations

from dataclasses import replace

import cv2
import pytest

from tools.experiment import ExperimentSettings
from tools.experiment_merges import lacks, run


@pytest.fixture(scope="module")
def outcome(rooms_parts, tmp_path_factory):
    return run(rooms_parts, ExperimentSettings(1, 0, 1), tmp_path_factory.mktemp("5.3"))


def test_the_finest_map_is_merged_with_each_resolution_of_the_other(outcome):
    for table in outcome.tables:
        assert [row[:2] for row in table.rows] == [["20", "20"], ["20", "10"]]
    default = outcome.json["merges"][-2:]
    assert [each["method"] for each in default] == ["default", "default"]
    assert [each["accepted"] and each["right"] for each in default] == [True, True]
    assert default[0]["from_first_m"] == 0.0
    assert 0.0 < default[1]["from_first_m"] < 0.1


def test_the_picture_is_drawn_and_says_that_it_is_simulated(outcome, tmp_path):
    (picture,) = outcome.pictures
    picture.draw(tmp_path / "a.png")
    assert cv2.imread(str(tmp_path / "a.png")).std() > 5.0
    assert "simulated data" in picture.caption


def test_one_resolution_is_too_few(rooms_parts):
    assert "two resolutions" in str(lacks(replace(rooms_parts, maps=rooms_parts.maps[::2])))
