"""Pairs from any drive, and the command that makes them: logs with poses, recordings with a trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.carmen_lines import beam_angles
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.trajectory import Trajectory, write_tum
from tools.pair_files import read_pairs
from tools.recorded_pairs import Drive, read_drive


@pytest.fixture
def log(corridor_log):
    """The drive as a corrected CARMEN log."""
    return corridor_log


def test_a_log_with_poses_is_read_as_it_was_driven(log, corridor_drive):
    scans = read_drive(Drive(log))
    assert scans.building == "hall"
    assert np.abs(scans.poses - corridor_drive.poses).max() < 1e-5
    assert np.abs(scans.points[60] - corridor_drive.points[60]).max() < 1e-3
    assert len(beam_angles(181)) == len(scans.points[60])


def test_a_recording_is_read_with_its_trajectory(log, corridor_drive, tmp_path):
    """The same file once more, as a raw log whose poses do not count: stamps lead to the trajectory's."""
    raw = tmp_path / "raw.log"
    lines = log.read_text().splitlines()
    raw.write_text("".join(f"{line[: -len('1.0 host 1.0')]}{k}.5 host {k}.5\n" for k, line in enumerate(lines, 10)))
    stamps = np.arange(10, 10 + len(lines), dtype=np.int64) * 1_000_000_000 + 500_000_000
    moved = corridor_drive.poses + np.array([100.0, 0.0, 0.0])
    write_tum(tmp_path / "trajectory.tum", Trajectory(stamps, moved))
    scans = read_drive(Drive(raw, tmp_path / "trajectory.tum"))
    assert np.abs(scans.poses - moved)[:, :2].max() < 1e-3
    assert len(scans.points) == len(lines)
    assert scans.building == "raw"


def test_the_command_makes_pairs_with_others_and_refuses_a_folder_that_is_there(log, cli, tmp_path):
    other = OccupancyGrid(np.where(np.eye(60) > 0, 3.0, -3.0).astype(np.float32), 0.05, np.zeros(3))
    house = write_map(tmp_path / "house", other)
    arguments = ("pairs", log, "-o", tmp_path / "pairs", "--windows", "1", "--wrong", "1", "--kinds", "lidar,camera")
    outcome = cli(*arguments, "--others", house.yaml, "--others", house.lossless)
    assert outcome.code == 0, outcome.err
    pairs = read_pairs(tmp_path / "pairs")
    assert {pair.kind for pair in pairs if pair.truth} == {"lidar", "camera"}
    assert {(pair.building_a, pair.building_b) for pair in pairs if not pair.truth} == {
        ("hall", "hall"),
        ("hall", "house"),
    }
    assert not (tmp_path / "pairs.part").exists()
    again = cli(*arguments)
    assert (again.code, len(again.error_lines)) == (1, 1)


def test_drives_of_one_building_are_named_so_and_their_lists_joined(log, cli, tmp_path):
    for name in ("monday", "tuesday"):
        arguments = ("-o", tmp_path / name, "--windows", "1", "--wrong", "1", "--kinds", "bent", "--tries", "60")
        assert cli("pairs", log, *arguments, "--building", "town-hall").code == 0
    outcome = cli("pairs", "--join", tmp_path / "monday", "--join", tmp_path / "tuesday", "-o", tmp_path / "week")
    assert outcome.code == 0, outcome.err
    one, week = read_pairs(tmp_path / "monday"), read_pairs(tmp_path / "week")
    assert {pair.building_a for pair in week} == {pair.building_b for pair in week} == {"town-hall"}
    assert [pair.name for pair in week[: len(one)]] == [f"monday-{pair.name}" for pair in one]
    assert len({pair.name for pair in week}) == len(week) == 2 * len(one)
    for pair, joined in zip(one, week, strict=False):
        assert joined.a.resolve() == pair.a.resolve()
        assert joined.a.is_file()
        assert (joined.truth is None) == (pair.truth is None)
    again = cli("pairs", "--join", tmp_path / "monday", "--join", tmp_path / "monday", "-o", tmp_path / "twice")
    assert (again.code, len(again.error_lines)) == (1, 1)
    assert not (tmp_path / "twice").exists()


def test_bad_input_is_one_line(log, cli, tmp_path):
    short, empty = tmp_path / "short.log", tmp_path / "empty.log"
    short.write_text("\n".join(log.read_text().splitlines()[:60]) + "\n")
    empty.write_text("no log\n")
    for arguments, code in (
        ([short], 1),
        ([empty], 1),
        ([tmp_path / "none.log"], 1),
        (["--public", tmp_path], 1),
        ([log, "--others", tmp_path / "none.yaml"], 1),
        ([], 2),
        ([log, "--public", tmp_path], 2),
        ([log, "--kinds", "sonar"], 2),
        ([log, "--trajectory", "a.tum", "--trajectory", "b.tum"], 2),
        ([log, "--building", "a", "--building", "b"], 2),
        ([log, "--join", tmp_path], 2),
        (["--join", tmp_path], 1),
    ):
        outcome = cli("pairs", *arguments, "-o", tmp_path / "pairs")
        assert (outcome.code, len(outcome.error_lines)) == (code, 1), outcome.err
        assert not (tmp_path / "pairs").exists()
        assert not (tmp_path / "pairs.part").exists()


def test_a_place_without_room_is_told_before_the_work(log, cli, tmp_path):
    (tmp_path / "file").write_text("years of work")
    for place in (tmp_path / "file/below", tmp_path / ("x" * 300), tmp_path / "file"):
        outcome = cli("pairs", log, "-o", place)
        assert (outcome.code, len(outcome.error_lines)) == (1, 1), outcome.err
    assert (tmp_path / "file").read_text() == "years of work"
