"""`fuse --watch` as a command, on robots' folders that change while it looks."""

from __future__ import annotations

import json
import shutil
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_lossless
from tools.errors import ToolError
from tools.map_watch import RobotFolders, watch_maps
from tools.pair_registration import Registration
from tools.signals import Stop

REGISTRATION = Registration("default", THESIS, 0)
GRID = OccupancyGrid(np.full((40, 40), -1.0, np.float32), 0.05, np.zeros(3))


class Script(Stop):
    """A stop that does the next thing of a script each time that the watch waits, and stops after the last one."""

    def __init__(self, *steps):
        super().__init__()
        self.steps = list(steps)

    def wait(self, timeout=None):
        if self.steps:
            self.steps.pop(0)()
        else:
            self.set()
        return self.is_set()


def watched(folders, output, *steps):
    """Watch while a script of changes runs, three looks each; return the folder and the last report."""
    idle = [lambda: None] * 3
    script = [each for step in steps for each in (step, *idle)]
    return watch_maps(folders, output, REGISTRATION, 1, every_s=0.01, stop=Script(*idle, *script))


@pytest.fixture
def robots(tmp_path, rooms_part):
    """Two folders, and a function that lets a robot's map be seen up to some column."""
    frames = {"one": np.zeros(3), "two": np.array([4.0, -7.0, 1.1])}
    spans = {"one": (0, 1), "two": (320, -1)}
    for name in frames:
        (tmp_path / name).mkdir()

    def leave(name, columns):
        start, way = spans[name]
        first, last = sorted((start, start + way * columns))
        write_lossless(tmp_path / name / "map.npz", rooms_part(len(name), first, last, frames[name]))

    return [tmp_path / name for name in frames], leave


def test_two_robots_are_merged_once_they_have_settled_and_all_files_are_there(robots, tmp_path, caplog):
    caplog.set_level("INFO")
    folders, leave = robots

    def both(columns):
        def step():
            leave("one", columns)
            leave("two", columns)

        return step

    folder, report = watched(folders, tmp_path / "out", *(both(columns) for columns in (120, 210, 235, 260)))
    assert folder == tmp_path / "out"
    assert {entry["group"] for entry in report["maps"]} == {0}
    assert report["growing"][0]["merged"]
    assert json.loads((folder / "report.json").read_text()) == report
    assert sorted(path.name for path in folder.glob("global_*.npz")) == ["global_0.npz"], (
        "global_1 is of an earlier state"
    )
    fused = read_map(folder / "global_0.npz")
    assert np.count_nonzero(fused.free) * 0.05**2 > 0.9 * 16.0 * 12.0 * 0.8
    _, again = watched(folders, tmp_path / "out")
    assert again["growing"][0]["merged"], "a new start does not begin anew"
    assert again["registrations"]["registered"] == 0
    lines = [line for line in caplog.messages if "one: " in line]
    assert any("first map" in line and "apart" in line for line in lines)
    assert any("settled: moved" in line and "one map" in line for line in lines)


def free_space(width):
    """A map without a wall, which is not aligned with any other: that costs no time."""
    return OccupancyGrid(np.full((40, width), -3.0, np.float32), 0.05, np.zeros(3))


def test_what_goes_wrong_with_files_is_named_and_the_last_maps_stay(tmp_path, caplog):
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder, width in zip(folders, (100, 60), strict=True):
        folder.mkdir()
        write_lossless(folder / "map.npz", free_space(width))
    whole = (folders[0] / "map.npz").read_bytes()

    _, report = watched(
        folders,
        tmp_path / "out",
        lambda: (folders[0] / "map.npz").write_bytes(whole[: len(whole) // 2]),
        (folders[1] / "map.npz").unlink,
        lambda: shutil.rmtree(folders[1]),
        lambda: write_lossless(folders[0] / "map.npz", free_space(110)),
    )
    assert "not a lossless map, or a damaged one" in caplog.text
    assert "its map is gone: the last one is kept" in caplog.text
    assert [robot["known_m2"] > 0.0 for robot in report["watched"]] == [True, True]
    assert len(report["maps"]) == 2


def test_a_folder_that_appears_later_is_taken_up(tmp_path):
    cars = tmp_path / "cars"
    out = cars / "fused"  # the result itself is no robot's

    def appear(name):
        def step():
            (cars / name).mkdir()
            write_lossless(cars / name / "map.npz", GRID)

        return step

    cars.mkdir()
    _, report = watched([cars], out, appear("first"), appear("second"))
    assert [Path(robot["robot"]).name for robot in report["watched"]] == ["first", "second"]


def test_a_robot_that_started_again_leaves_its_former_map_in_a_file(tmp_path, caplog):
    robot = tmp_path / "one"
    robot.mkdir()
    before = free_space(120)
    write_lossless(robot / "map.npz", before)
    _, report = watched([robot], tmp_path / "out", lambda: write_lossless(robot / "map.npz", free_space(30)))
    kept = tmp_path / "out/kept/one_1.npz"
    np.testing.assert_array_equal(read_map(kept).log_odds, before.log_odds)
    assert sorted(entry["file"] for entry in report["maps"]) == sorted([str(kept), str(robot / "map.npz")])
    assert "the robot started again" in caplog.text


def test_a_file_beside_the_folders_is_a_finished_map(tmp_path):
    (tmp_path / "one").mkdir()
    write_lossless(tmp_path / "one/map.npz", free_space(60))
    write_lossless(tmp_path / "plan.npz", GRID)
    _, report = watched([tmp_path / "plan.npz", tmp_path / "one"], tmp_path / "out")
    assert [robot["finished"] for robot in report["watched"]] == [True, False]


def test_without_any_map_it_ends_with_one_line(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(ToolError, match="no map came in"):
        watched([tmp_path / "empty", tmp_path / "none"], tmp_path / "out")


def test_a_folder_named_twice_is_one_robot(tmp_path):
    (tmp_path / "a").mkdir()
    write_lossless(tmp_path / "a/map.npz", GRID)
    folders = RobotFolders([tmp_path / "a", tmp_path / "b/../a", tmp_path], tmp_path / "out")
    (tmp_path / "b").mkdir()
    folders.look()
    assert len(folders.robots) == 1


def test_ctrl_c_ends_it_with_the_last_result(robots, spawn, tmp_path):
    folders, leave = robots
    leave("one", 60)
    process = spawn("fuse", "--watch", *folders, tmp_path / "later", "-o", tmp_path / "out", "--every", "0.1")
    report = tmp_path / "out/report.json"
    patience = threading.Event()
    until = time.monotonic() + 60.0
    while not report.exists() and time.monotonic() < until and process.process.poll() is None:
        patience.wait(0.05)
    ended = process.end(signal.SIGINT)
    assert ended.code == 0, ended.err
    assert "Traceback" not in ended.err
    assert (tmp_path / "out/global_0.yaml").exists()
    assert len(json.loads(report.read_text())["maps"]) == 1


def test_the_method_of_the_thesis_is_not_for_maps_that_grow(cli, tmp_path):
    outcome = cli("fuse", "--watch", tmp_path, "--method", "thesis")
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)
