"""Table 5.1: counts, means and deviations of many merges."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tools.experiment import ExperimentSettings
from tools.experiment_runs import lacks, merge_runs, paired, run, summarised, true_pose
from tools.merging_methods import METHODS
from tools.pair_registration import Registration


@pytest.fixture(scope="module")
def one_resolution(rooms_parts):
    return replace(rooms_parts, maps=tuple(each for each in rooms_parts.maps if each.resolution_m < 0.06))


@pytest.fixture(scope="module")
def outcome(one_resolution, tmp_path_factory):
    folder = tmp_path_factory.mktemp("5.1")
    return folder, run(one_resolution, ExperimentSettings(2, 0, 1), folder)


def test_pairs_are_those_of_the_thesis(rooms_parts):
    pairs = [(a.name, b.name) for a, b in paired(rooms_parts)]
    assert pairs == [("a-r20", "b-r20"), ("a-r10", "b-r10"), ("a-r20", "b-r10")]
    assert lacks(rooms_parts) is None


def test_sets_without_two_parts_and_a_truth_lack_it(rooms_parts, box_set):
    assert "kind parts" in str(lacks(box_set))
    unknown = tuple(replace(each, pose=None) for each in rooms_parts.maps)
    assert "kind parts" in str(lacks(replace(rooms_parts, maps=unknown)))


def test_each_method_has_a_table_and_the_thesis_its_own(outcome):
    _, found = outcome
    assert [table.title.split(":")[0] for table in found.tables[:-1]] == [each.title for each in METHODS.values()]
    assert "OTHER data" in found.tables[-1].title
    for table in found.tables[:-1]:
        (row,) = table.rows
        assert row[:2] == ["20", "20"]
        assert row[2:4] == ["2 of 2", "2"]  # the rooms are easy
        assert float(row[10].split(",")[0]) < 0.1
    json.dumps(found.json)


def test_finished_rows_are_not_merged_again(outcome, one_resolution, monkeypatch):
    folder, found = outcome
    lines = (folder / "rows.jsonl").read_text()
    again = run(one_resolution, ExperimentSettings(2, 0, 1), folder)
    assert (folder / "rows.jsonl").read_text() == lines
    assert [table.rows for table in again.tables] == [table.rows for table in found.tables]


def test_errors_are_those_against_the_truth(one_resolution):
    ((a, b),) = paired(one_resolution)
    registration = Registration("default", METHODS["default"].registration.settings, 0)
    row = merge_runs(a.path, b.path, true_pose(a, b), registration, 1)
    assert row["error_m"][0] < 0.05
    off = true_pose(a, b) + np.array([0.3, 0.4, 0.0])
    assert merge_runs(a.path, b.path, off, registration, 1)["error_m"][0] == pytest.approx(0.5, abs=0.05)


def test_means_are_over_the_runs_with_a_pose_and_angles_go_round():
    row = {
        "accepted": [True, False, True, False],
        "acceptance": [0.9, 0.8, 0.7, 0.0],
        "inliers": [10, 20, 30, None],
        "T_a_b": [[1.0, 2.0, np.radians(179.0)], [1.0, 4.0, np.radians(-179.0)], [1.0, 3.0, np.pi], None],
        "error_m": [0.1, 2.0, 0.3, None],
        "error_deg": [0.5, 1.0, 4.0, None],
        "seconds": [1.0, 3.0],
        "cpu_seconds": [1.0, 1.0],
    }
    found = summarised(row)
    assert (found["accepted"], found["accepted_right"], found["right"], found["found"], found["count"]) == (
        2,
        1,
        1,
        3,
        4,
    )
    assert found["acceptance"][0] == pytest.approx(0.8)
    assert found["inliers"] == pytest.approx([20.0, np.sqrt(200.0 / 3.0)])
    assert abs(found["rotation_deg"][0]) == pytest.approx(180.0)
    assert found["rotation_deg"][1] == pytest.approx(np.sqrt(2.0 / 3.0))
    assert found["translation_m"] == pytest.approx([1.0, 3.0, np.sqrt(2.0 / 3.0)])
    assert found["error_m"] == [0.3, 2.0]
    assert found["seconds"] == [2.0, 1.0]


def test_runs_without_any_pose_are_counted():
    nothing = {
        **{key: [None] for key in ("inliers", "T_a_b", "error_m", "error_deg")},
        "accepted": [False], "acceptance": [0.0], "seconds": [1.0], "cpu_seconds": [1.0],
    }  # fmt: skip
    assert summarised(nothing)["found"] == 0
