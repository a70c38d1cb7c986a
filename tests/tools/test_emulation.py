"""`emulate lidar` and what it refuses."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize("pose", [("nan", "0", "0"), ("0", "inf", "0"), ("0", "0", "-inf")])
def test_a_pose_that_is_none_is_wrong_usage(pose, cli):
    outcome = cli("emulate", "lidar", "--pose", *pose)
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)
    assert "--pose" in outcome.error_lines[0]


def test_a_truth_that_could_not_be_written_is_refused_before_the_drive(cli, tmp_path):
    outcome = cli("emulate", "lidar", "--truth", tmp_path / "none/truth.tum")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert outcome.out == ""


@pytest.mark.parametrize(
    "options",
    [
        ("--model", "A1"),
        ("--world", "map.yaml"),
        ("--world", "office", "--drive", "wings-west"),
        ("--pose", "0", "0", "0", "--trajectory", "x"),
    ],
)
def test_options_that_do_not_fit_are_wrong_usage(options, cli):
    assert cli("emulate", "lidar", *options).code == 2
