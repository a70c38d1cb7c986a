"""Experiments 4.7 and 4.8: a random rotation is recovered, and failures are counted apart."""

from __future__ import annotations

import cv2
import pytest

from tools.experiment import ExperimentSettings
from tools.experiment_rotation import rotation_by_rate, rotation_by_resolution, rotation_row, scores_of
from tools.matched_images import METHODS

SETTINGS = ExperimentSettings(2, 1, 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rows")


def test_the_rotation_of_a_map_of_one_resolution_is_found(box_set):
    row = rotation_row(box_set.maps[1], box_set.maps[3], 0.5, METHODS[0], SETTINGS)
    assert {len(values) for values in row.values()} == {2}
    scores = scores_of(row)
    assert (scores.found, scores.wrong) == (2, 0)
    assert scores.rmse_deg is not None
    assert scores.rmse_deg < 0.5
    assert scores.seconds > 0.0
    again = rotation_row(box_set.maps[1], box_set.maps[3], 0.5, METHODS[0], SETTINGS)
    assert again["error_deg"] == row["error_deg"]


def test_runs_without_a_motion_are_counted_and_have_no_error():
    row = {"error_deg": [3.0, None, -4.0, 90.0], "seconds": [1.0, 2.0, 3.0, 2.0], "inliers": [5, 0, 5, 2]}
    scores = scores_of(row)
    assert (scores.runs, scores.found, scores.wrong) == (4, 3, 1)
    assert scores.rmse_right_deg == pytest.approx((12.5) ** 0.5)
    assert scores.rmse_deg == pytest.approx((8125.0 / 3.0) ** 0.5)
    assert (scores.median_deg, scores.seconds) == (4.0, 2.0)
    nothing = scores_of({"error_deg": [None], "seconds": [1.0], "inliers": [0]})
    assert (nothing.found, nothing.rmse_deg, nothing.rmse_right_deg, nothing.median_deg) == (0, None, None, None)


def test_both_experiments_have_a_row_for_every_map_and_method_and_a_picture(box_set, folder, tmp_path):
    for run, first_column, alphas in (
        (rotation_by_resolution, ["10", "20"], ["0.99"]),
        (rotation_by_rate, ["2.50", "1.25"], ["0.99", "0.5"]),
    ):
        outcome = run(box_set, SETTINGS, folder / run.__name__)
        (table,) = outcome.tables
        assert [row[:3] for row in table.rows] == [
            [f"O^free, alpha {alpha}", name, tick]
            for alpha in alphas
            for name in ("KAZE", "ORB", "SIFT")
            for tick in first_column
        ]
        assert {row[3].split()[-1] for row in table.rows} == {"2"}
    outcome.pictures[0].draw(tmp_path / "x.png")
    assert cv2.imread(str(tmp_path / "x.png")).std() > 5.0
    lines = (folder / "rotations.jsonl").read_text().split()
    assert "".join(lines).count('"key"') == 15  # the map that both experiments turn is turned once
