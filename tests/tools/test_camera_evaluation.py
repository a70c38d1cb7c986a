"""The verdict on pairs, and the command on one short-sighted building: the smallest run there is."""

from __future__ import annotations

import json

import cv2
import pytest

from tools.camera_evaluation import outcome_of, summary_of, table_of
from tools.results import Report

TRUE: Report = {
    "true": True, "accepted": True, "rms_m": 0.05, "rotation_deg": 0.3, "camera_rms_m": 0.04, "lidar_seed": 3,
    "camera_seed": 3, "probability": 0.99, "agreeing_wall_m": 40.0, "contradicting_wall_m": 1.0, "drives_rms_m": 0.03,
    "common_free": 0.8, "common_wall_m": 38.0, "drives_rotation_deg": 0.2,
}  # fmt: skip
WRONG: Report = TRUE | {"true": False, "accepted": False, "rms_m": None, "rotation_deg": None, "camera_seed": 4}


@pytest.mark.parametrize(
    ("changed", "outcome"),
    [
        ({}, "fused"),
        ({"rms_m": 0.15}, "fused, off"),
        ({"rotation_deg": 2.1}, "fused, off"),
        ({"accepted": False}, "refused, right pose"),
        ({"accepted": False, "rms_m": 3.0}, "refused"),
        ({"accepted": False, "rms_m": None, "rotation_deg": None}, "refused"),
    ],
)
def test_outcome_of_a_true_pair(changed, outcome):
    assert outcome_of(TRUE | changed) == outcome


def test_wrong_pairs_must_be_refused():
    assert outcome_of(WRONG) == "refused"
    assert outcome_of(WRONG | {"accepted": True}) == "wrong merge"


def test_counts_and_table():
    rows = [
        TRUE, TRUE | {"rms_m": 0.4}, TRUE | {"accepted": False}, TRUE | {"accepted": False, "rms_m": 2.0},
        WRONG, WRONG | {"accepted": True},
    ]  # fmt: skip
    rows = [row | {"outcome": outcome_of(row)} for row in rows]
    summary = summary_of(rows)
    assert (summary["true_pairs"], summary["fused"], summary["fused_off"]) == (4, 1, 1)
    assert summary["fused_by_drives"] == 2  # the one that is off is right but for the camera's own start
    assert (summary["refused"], summary["refused_right_pose"]) == (2, 1)
    assert (summary["wrong_pairs"], summary["wrong_accepted"]) == (2, 1)
    assert summary["fused_rms_m_median"] == 0.05
    lines = table_of(summary | {"rows": rows}).splitlines()
    assert len(lines) == 2 + len(rows) + 1
    assert lines[0].startswith("SIMULATED")
    assert "1 of 4 true pairs fused" in lines[-1]
    assert "1 of 2 wrong pairs accepted" in lines[-1]


@pytest.mark.parametrize("options", [("--seeds", "3-1"), ("--seeds", "a"), ("--size", "848"), ("--size", "8x8")])
def test_options_that_make_no_sense_are_refused_in_one_line(options, cli, tmp_path):
    result = cli("-q", "evaluate", "camera", "-o", tmp_path / "out", *options)
    assert (result.code, result.out) == (2, "")
    assert len(result.err.splitlines()) == 1
    assert options[0] in result.err
    assert not (tmp_path / "out").exists()


def test_one_building_is_mapped_and_fused_and_what_fuse_needs_is_there(cli, tmp_path):
    little = ("--size", "424x240", "--fps", "3")  # a quarter of the pixels, half of the images
    result = cli("-q", "evaluate", "camera", "-o", tmp_path, "--seeds", "2", "--jobs", "1", *little, "--json")
    report = json.loads(result.out)
    (row,) = report["rows"]
    assert report["simulated"] is True
    assert (report["true_pairs"], report["wrong_pairs"]) == (1, 0)
    assert row["accepted"]
    assert row["drives_rms_m"] < 0.1
    assert result.code == (0 if row["outcome"] == "fused" else 1)
    assert json.loads((tmp_path / "report.json").read_text()) == report
    for name in ("map.yaml", "map.pgm", "map.npz", "trajectory.tum", "report.json"):
        assert (tmp_path / "seed_2" / "camera" / name).is_file()
        assert (tmp_path / "seed_2" / "lidar" / name).is_file()
    picture = cv2.imread(str(tmp_path / "pairs.png"))
    assert picture.shape[0] > 300
