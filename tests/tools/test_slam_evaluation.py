"""`evaluate slam` on files, and the table that it prints."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapping import se2
from mapping.trajectory import Trajectory, write_tum

COUNT = 60


def drive():
    """A circle of 6 m radius in a minute, a pose a second."""
    angle = np.linspace(0.0, 2 * np.pi, COUNT)
    return Trajectory(
        np.arange(COUNT) * 10**9, np.column_stack([6 * np.sin(angle), 6 - 6 * np.cos(angle), se2.wrap_angle(angle)])
    )


@pytest.fixture
def files(tmp_path):
    """Truth in both kinds, a trajectory without error in another frame, and one that is off at the end."""
    truth = drive()
    write_tum(tmp_path / "truth.tum", truth)
    pairs = [(n, n + 5) for n in range(0, 50, 5)] + [(0, 30), (10, 59)]
    lines = []
    for first, second in pairs:
        x, y, yaw = se2.between(truth.poses[first], truth.poses[second]).tolist()
        lines.append(f"{first}.0 {second}.0 {x!r} {y!r} 0 0 0 {yaw!r}\n")
    (tmp_path / "truth.relations").write_text("".join(lines))
    write_tum(tmp_path / "good.tum", Trajectory(truth.stamps_ns, se2.compose([3.0, -1.0, 2.0], truth.poses)))
    off = truth.poses.copy()
    off[-1] = se2.compose(off[-1], [0.3, 0.4, 0.1])
    write_tum(tmp_path / "off.tum", Trajectory(truth.stamps_ns, off))
    write_tum(tmp_path / "half.tum", Trajectory(truth.stamps_ns[:40], truth.poses[:40]))
    write_tum(tmp_path / "other.tum", Trajectory(truth.stamps_ns + 10**15, truth.poses))
    return tmp_path


def scores(cli, *arguments):
    outcome = cli("evaluate", "slam", *arguments, "--json")
    assert outcome.code in {0, 3}, outcome.err
    return json.loads(outcome.out)


def test_relations_give_the_relations_metric(cli, files):
    found = scores(cli, files / "off.tum", files / "truth.relations")
    assert found["metric"] == "relations"
    assert (found["relations"], found["unmatched"], found["unmatched_share"]) == (12, 0, 0.0)
    assert found["max_m"] == pytest.approx(0.5, abs=1e-6)
    assert found["short"]["relations"] == 10
    assert found["short"]["max_m"] == pytest.approx(0.0, abs=1e-6)


def test_trajectory_gives_absolute_and_relative_errors(cli, files):
    good = scores(cli, files / "good.tum", files / "truth.tum")
    assert good["metric"] == "trajectory"
    assert good["ate"]["poses"] == COUNT
    assert good["ate"]["rms_m"] == pytest.approx(0.0, abs=1e-6)
    assert good["rpe"]["max_m"] == pytest.approx(0.0, abs=1e-6)
    off = scores(cli, files / "off.tum", files / "truth.tum", "--delta", "5", "--delta-unit", "s")
    assert off["rpe"]["delta_unit"] == "s"
    assert off["rpe"]["interval"] == pytest.approx(5.0)
    assert off["rpe"]["max_m"] == pytest.approx(0.5, abs=1e-6)
    assert off["rpe"]["max_deg"] == pytest.approx(np.degrees(0.1), abs=1e-4)
    assert off["rpe"]["mean_m"] == pytest.approx(0.5 / 55, abs=1e-6)
    assert 0.0 < off["ate"]["median_m"] < off["ate"]["rms_m"] < off["ate"]["max_m"] < 0.5


@pytest.mark.parametrize("truth", ["truth.tum", "truth.relations"])
def test_several_trajectories_give_one_table(cli, files, truth):
    names = [files / "good.tum", files / "off.tum"]
    results = scores(cli, *names, files / truth)["results"]
    assert [row["trajectory"] for row in results] == [str(name) for name in names]
    outcome = cli("evaluate", "slam", *names, files / truth)
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert len(lines) == 4
    assert lines[2].startswith(str(names[0]))
    assert lines[3].startswith(str(names[1]))
    assert len(lines[2].split()) == len(lines[3].split())
    assert ("ATE" in lines[0]) == (truth == "truth.tum")
    ends = [
        {place for place in range(1, len(line)) if line[place - 1] != " " and line[place] == " "} for line in lines[2:]
    ]
    assert ends[0] - ends[1] <= {len(str(names[0]))}


def test_relations_without_a_pose_are_exit_code_3_and_shown(cli, files):
    outcome = cli("evaluate", "slam", files / "half.tum", files / "truth.relations")
    assert outcome.code == 3
    assert "33.3%" in outcome.out
    found = scores(cli, files / "half.tum", files / "truth.tum")
    assert found["ate"]["truth_covered"] == pytest.approx(40 / 60)


@pytest.mark.parametrize("truth", ["truth.tum", "truth.relations"])
def test_trajectory_of_another_log_is_one_line_that_names_both(cli, files, truth):
    outcome = cli("evaluate", "slam", files / "good.tum", files / "other.tum", files / truth)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "other.tum" in outcome.error_lines[0]
    assert truth in outcome.error_lines[0]
    assert outcome.out == ""


@pytest.mark.parametrize("arguments", [[], ["--delta", "0"], ["--delta", "nan"], ["--delta-unit", "km"]])
def test_wrong_use_is_exit_code_2(cli, files, arguments):
    given = [files / "good.tum", files / "truth.tum"] if arguments else [files / "good.tum"]
    assert cli("evaluate", "slam", *given, *arguments).code == 2


def test_interval_that_no_two_poses_have_is_one_line(cli, files):
    outcome = cli("evaluate", "slam", files / "good.tum", files / "truth.tum", "--delta", "1000")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "1000 m" in outcome.error_lines[0]
