"""Experiments are written one by one, skipped with a reason, and not run twice."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.experiment import Experiment, ExperimentKind, ExperimentSettings, Picture, Table
from tools.experiment_report import run_experiments, table_lines
from tools.map_data_set import read_data_set


@pytest.fixture
def data(tmp_path):
    (tmp_path / "maps").mkdir()
    write_map(tmp_path / "maps/a", OccupancyGrid(np.ones((3, 4), np.float32), 0.1, np.zeros(3)))
    return read_data_set(tmp_path / "maps")


def dot(file):
    file.write_bytes(b"dot")


class Counted:
    """An experiment that counts how often it is run."""

    def __init__(self, *, complete: bool = True) -> None:
        self.runs: list[int] = []
        self._complete = complete

    def __call__(self, data, settings, folder):
        self.runs.append(settings.runs)
        table = Table("Means", ["r", "n"], [["8", "3"], ["10", "14"]], "n: how many.")
        picture = Picture("A dot.", dot)
        return Experiment([table], [picture, picture], {"n": [3, 14]}, ["A remark."], self._complete)


def run(tmp_path, data, kinds, runs=5):
    folder = tmp_path / "out"
    folder.mkdir(exist_ok=True)
    settings = ExperimentSettings(runs, 0, 1)
    return run_experiments(kinds, data, settings, folder, "evaluate fusion maps -o out", lambda _: None)


def test_files_tell_the_table_the_source_and_the_command(data, tmp_path):
    counted = Counted()
    done = run(tmp_path, data, {"5.5/5.6": ExperimentKind("six maps", lambda _: None, counted)})
    assert [(each.name, each.skipped, each.again, each.complete) for each in done] == [("5.5/5.6", None, False, True)]
    text = (tmp_path / "out/5.5-5.6.md").read_text()
    for part in ("six maps", "| 10 | 14 |", "n: how many.", "A remark.", data.source, "evaluate fusion maps -o out"):
        assert part in text
    assert {file.name for file in (tmp_path / "out").glob("*.png")} == {"5.5-5.6.png", "5.5-5.6-2.png"}
    content = json.loads((tmp_path / "out/5.5-5.6.json").read_text())
    assert content["results"] == {"n": [3, 14]}
    assert content["settings"] == {"runs": 5, "seed": 0}
    assert content["simulated"] is False
    assert "(5.5-5.6.md)" in (tmp_path / "out/README.md").read_text()


def test_a_finished_experiment_is_run_again_for_other_settings_or_maps_only(data, tmp_path):
    counted = Counted(complete=False)
    kinds = {"4.3": ExperimentKind("counts", lambda _: None, counted)}
    run(tmp_path, data, kinds)
    (again,) = run(tmp_path, data, kinds)
    assert (again.again, again.complete, counted.runs) == (True, False, [5])
    run(tmp_path, data, kinds, runs=6)
    assert counted.runs == [5, 6]
    write_map(data.folder / "a", OccupancyGrid(np.zeros((3, 4), np.float32), 0.1, np.zeros(3)))
    run(tmp_path, data, kinds, runs=6)
    assert counted.runs == [5, 6, 6]


def test_a_run_that_was_cut_off_is_run_again(data, tmp_path):
    counted = Counted()
    kinds = {"4.3": ExperimentKind("counts", lambda _: None, counted)}
    run(tmp_path, data, kinds)
    file = tmp_path / "out/4.3.json"
    file.write_text(file.read_text()[:-20])
    run(tmp_path, data, kinds)
    assert counted.runs == [5, 5]


def test_what_the_set_lacks_is_named_and_the_others_are_run(data, tmp_path):
    counted = Counted()
    kinds = {
        "5.4": ExperimentKind("growing maps", lambda _: "no growing maps", counted),
        "4.3": ExperimentKind("counts", lambda _: None, counted),
    }
    done = run(tmp_path, data, kinds)
    assert [each.skipped for each in done] == ["no growing maps", None]
    assert len(counted.runs) == 1
    assert "skipped: no growing maps" in (tmp_path / "out/README.md").read_text()


def test_the_index_names_what_earlier_runs_left_there_with_the_same_settings(data, tmp_path):
    kinds = {name: ExperimentKind(f"title of {name}", lambda _: None, Counted()) for name in ("4.3", "4.4", "4.5")}
    run(tmp_path, data, {"4.3": kinds["4.3"]})
    run(tmp_path, data, {"4.4": kinds["4.4"]}, runs=9)
    run(tmp_path, data, {"4.5": kinds["4.5"]})
    index = (tmp_path / "out/README.md").read_text()
    assert "title of 4.3" in index
    assert "title of 4.5" in index
    assert "title of 4.4" not in index


def test_a_table_is_markdown_with_as_many_bars_in_each_row():
    lines = table_lines(Table("T", ["a", "long head"], [["1", "2"], ["100", ""]]))
    assert lines[0] == "**T**"
    assert {line.count("|") for line in lines[2:]} == {3}
    assert len({len(line) for line in lines[2:]}) == 1
