"""Trajectories beside maps, and where they are in a fused map."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mapping import se2
from mapping.map_io import write_map
from mapping.trajectory import Trajectory, read_tum, write_tum
from tools.map_data_set import LIST_NAME
from tools.robot_poses import RobotTrack, deviation, find_tracks, place, robot_lines, tracks_beside

TRACK = Trajectory(np.array([1_000, 2_000]) * 10**6, np.array([(0.0, 0.0, 0.0), (2.0, 1.0, 0.5)]))


@pytest.fixture
def folder(tmp_path):
    """A drive of `run`, a map with a trajectory of its name, one without any, and a fused map of two robots."""
    (tmp_path / "monday").mkdir()
    for name in (
        "monday/trajectory",
        "monday/trajectory_in_map",
        "west",
        "global_0_red",
        "global_0_blue",
        "global_1_x",
    ):
        write_tum(tmp_path / f"{name}.tum", TRACK)
    return tmp_path


@pytest.mark.parametrize(
    ("map_file", "tracks"),
    [
        ("monday/map.yaml", ["monday/trajectory.tum"]),
        ("monday/depth_map.npz", ["monday/trajectory.tum"]),
        ("west.yaml", ["west.tum"]),
        ("east.yaml", []),
        ("monday/other.yaml", []),
        ("global_0.npz", ["global_0_blue.tum", "global_0_red.tum"]),
    ],
)
def test_trajectories_are_found_beside_maps(folder, map_file, tracks):
    assert tracks_beside(folder / map_file) == [folder / track for track in tracks]


def test_robots_are_called_as_their_maps_and_none_counts_twice(folder):
    files = [folder / name for name in ("monday/map.npz", "monday/both_map.npz", "west.yaml", "global_0.yaml")]
    found = find_tracks(dict(enumerate(files)))
    assert [(each.robot, each.number) for each in found] == [("monday", 0), ("west", 2), ("blue", 3), ("red", 3)]


def test_a_data_set_says_whose_a_trajectory_is(rooms_set, tmp_path):
    shutil.copytree(rooms_set.folder, tmp_path / "set")
    text = (tmp_path / "set" / LIST_NAME).read_text()
    (tmp_path / "set" / LIST_NAME).write_text(text.replace('"robot": "mid"', '"robot": "car 7"'))
    found = find_tracks({4: tmp_path / "set/maps/mid.npz", 5: tmp_path / "set/maps/east.npz"})
    assert [(each.robot, each.number) for each in found] == [("car-7", 4), ("east", 5)]
    (tmp_path / "set" / LIST_NAME).write_text("{")
    assert [each.robot for each in find_tracks({4: tmp_path / "set/maps/mid.npz"})] == ["mid"]


def test_what_cannot_be_read_is_named(folder, caplog):
    (folder / "west.tum").write_text("1 2 3\n")
    (found,) = find_tracks({0: folder / "west.yaml"})
    assert found.trajectory is None
    assert "west.tum:1" in str(found.skipped)
    assert "west.tum:1" in caplog.text


def test_a_robot_is_where_its_map_is():
    (T_group_map, T_group_file) = np.array([5.0, 1.0, np.pi / 2]), np.array([5.0, 2.0, np.pi / 2])
    track = RobotTrack("car", 0, Path("car.tum"), TRACK)
    robot = place(track, 3, (T_group_map, T_group_file), np.diag([1e-4, 4e-4, 0.0]))
    np.testing.assert_allclose(robot.trajectory.poses[-1], [4.0, 4.0, np.pi / 2 + 0.5])
    np.testing.assert_array_equal(robot.trajectory.stamps_ns, TRACK.stamps_ns)
    assert robot.covariance is not None
    assert deviation(robot.covariance) == pytest.approx((0.02, 0.0))
    assert robot.file_name == "global_3_car.tum"
    assert place(track, 3, (T_group_map, T_group_file), None).covariance is None


def test_fuse_tells_where_all_robots_are(cli, rooms_set, rooms_pairs, tmp_path):
    (tmp_path / "out").mkdir()
    shutil.copy(rooms_pairs, tmp_path / "out")
    files = [each.path for each in rooms_set.maps]
    outcome = cli("fuse", *files, "-o", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert [entry["robot"] for entry in report["robots"]] == ["west", "mid", "east"]
    # All three drove along y = 5.6 in the rooms: where two maps are right, so are the drives to each other.
    west = np.array(report["maps"][0]["T_global_map"])
    for entry in report["robots"]:
        track = read_tum(tmp_path / "out" / entry["poses"])
        assert len(track) == 30
        np.testing.assert_allclose(track.poses[-1], entry["T_global_robot"], atol=1e-8)
        np.testing.assert_allclose(se2.between(west, track.poses)[:, 1], 5.6, atol=0.06)
        assert np.linalg.eigvalsh(np.array(entry["covariance"])).min() >= -1e-12
    assert "robot mid:" in outcome.out
    assert outcome.out.count("whose frame is that of its map") == 1
    assert outcome.out.count("its map +- 0.0") == 2
    # A fused map takes its robots along to the next.
    again = cli("fuse", tmp_path / "out/global_0.yaml", "-o", tmp_path / "again", "--json")
    assert [entry["robot"] for entry in json.loads(again.out)["robots"]] == ["east", "mid", "west"]


def test_maps_fuse_without_a_trajectory_that_cannot_be_read(cli, rooms_part, tmp_path):
    write_map(tmp_path / "a", rooms_part(1))
    (tmp_path / "a.tum").write_text("0 0 0 0 0 0 0\n")
    outcome = cli("fuse", tmp_path / "a.npz", "-o", tmp_path / "out")
    assert outcome.code == 3
    assert "a.tum:1" in outcome.err
    assert "robot a: skipped" in outcome.out
    assert (tmp_path / "out/global_0.npz").exists()
    (entry,) = json.loads((tmp_path / "out/report.json").read_text())["robots"]
    assert (entry["group"], entry["poses"], entry["covariance"]) == (None, None, None)


def test_the_method_of_the_thesis_tells_no_covariance(cli, rooms_set, tmp_path):
    files = [each.path for each in rooms_set.maps[:2]]
    outcome = cli("fuse", *files, "-o", tmp_path / "out", "--method", "thesis", "--json")
    assert outcome.code == 0, outcome.err
    robots = json.loads(outcome.out)["robots"]
    assert [entry["covariance"] for entry in robots] == [None, None]
    assert all(entry["T_global_robot"] for entry in robots)
    assert (tmp_path / "out/tree.png").stat().st_size > 0
    assert "+-" not in "".join(robot_lines(robots))
