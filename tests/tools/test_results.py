from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from drivers.messages import LaserScan
from drivers.rplidar_decoder import DecoderCounters
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.config import Config
from tools.errors import ToolError
from tools.pipeline import MappingFlow
from tools.results import (
    check_new_file,
    check_run_folder,
    decoding_summary,
    grid_snapshot,
    is_placed,
    lost_pieces,
    new_run_folder,
    remarks,
    save_results,
)


def flow_of_one_scan():
    flow = MappingFlow(Config(), Config().mount())
    angles = -np.linspace(0, 2 * np.pi, 200, endpoint=False)
    flow.feed(LaserScan(5_000_000_000, angles, np.full(200, 2.0), np.zeros(200), 0.1, 12.0))
    return flow


def test_results_of_a_run_are_all_there(tmp_path):
    report = save_results(tmp_path, flow_of_one_scan(), "somewhere", {"more": 1})
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"map.yaml", "map.pgm", "map.npz", "map.png", "pose_graph.png", "trajectory.tum", "report.json"}
    assert json.loads((tmp_path / "report.json").read_text()) == report
    assert report["scans"]["mapped"] == report["scans"]["in_map"] == 1
    assert report["more"] == 1
    assert read_map(tmp_path / "map.npz").occupied.sum() > 100


def test_nothing_mapped_still_makes_whole_files(tmp_path):
    report = save_results(tmp_path, MappingFlow(Config(), Config().mount()), "nowhere", {})
    assert report["trajectory"]["poses"] == 0
    assert "NaN" not in (tmp_path / "report.json").read_text()
    assert not read_map(tmp_path / "map.yaml").known.any()


def test_snapshot_for_other_tools_has_unknown_minus_one_and_per_cent():
    grid = OccupancyGrid(np.array([[0.0, -7.0, 7.0]], np.float32), 0.05, np.array([1.0, 2.0, 0.0]))
    snapshot = grid_snapshot(grid, 7)
    assert snapshot.cells.tolist() == [[-1, 0, 100]]
    assert snapshot.origin.tolist() == [1.0, 2.0, 0.0]


def test_streams_are_summed():
    assert decoding_summary([DecoderCounters(samples=3, scans=1), DecoderCounters(samples=4)])["samples"] == 7
    assert decoding_summary([]) == {}


def test_default_folder_is_under_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert new_run_folder(None).parent.name == "runs"
    assert new_run_folder(tmp_path / "a" / "b").is_dir()


def test_commands_that_begin_in_one_second_have_a_folder_each(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len({new_run_folder(None) for _ in range(5)}) == 5


def test_a_folder_that_cannot_be_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    for bad in (tmp_path / "file", tmp_path / "file/below", tmp_path / ("x" * 300)):
        with pytest.raises(ToolError, match="cannot write results"):
            check_run_folder(bad)
    check_run_folder(tmp_path / "a/b/c")
    assert not (tmp_path / "a").exists()


def test_a_file_without_a_folder_is_refused_before_the_work(tmp_path):
    (tmp_path / "kept").write_text("years of work")
    check_new_file(tmp_path / "kept")
    assert (tmp_path / "kept").read_text() == "years of work"
    for bad in (tmp_path / "none/truth.tum", tmp_path, tmp_path / ("x" * 300), Path("/proc/truth.tum")):
        with pytest.raises(ToolError, match="cannot write results"):
            check_new_file(bad)
    check_new_file(tmp_path / "truth.tum")
    assert not (tmp_path / "truth.tum").exists()


def piece(start_s: int, scans: int, *, in_map: bool) -> dict:
    return {"start_ns": start_s * 10**9, "end_ns": (start_s + scans) * 10**9, "scans": scans, "in_map": in_map}


def test_each_lost_piece_has_a_line():
    report = {"slam": {"segments": [piece(100, 9, in_map=False), piece(200, 80, in_map=True)]}}
    assert lost_pieces(report) == ["not in the map: 9 scans in 9 s, from the beginning at 100.000"]


def test_of_many_lost_pieces_the_longest_have_a_line_and_the_others_are_summed():
    segments = [piece(1000 * n, 10 + n, in_map=n == 4) for n in range(40)]
    *longest, rest = lost_pieces({"slam": {"segments": segments}})
    assert [line.split()[4] for line in longest] == ["44", "45", "46", "47", "48", "49"]
    shorter = sum(10 + n for n in range(34) if n != 4)
    assert rest == f"not in the map: 33 shorter pieces, {shorter} scans in {shorter} s: report.json lists them"


def test_a_car_that_was_not_found_on_its_map_is_not_all_done():
    whole = {"slam": {"segments": [piece(1, 3, in_map=True)]}}
    assert is_placed(whole)
    assert is_placed(whole | {"localisation": {"found": True}})
    assert not is_placed(whole | {"localisation": {"found": False}})
    assert not is_placed({"slam": {"segments": [piece(1, 3, in_map=False)]}})


def test_a_map_that_shows_nothing_is_told():
    whole = {"slam": {"segments": [piece(1, 3, in_map=True)]}, "map": {"occupied_cells": 3}}
    assert remarks(whole) == []
    (line,) = remarks(whole | {"map": {"occupied_cells": 0}, "depth": {}})
    assert "depth.mount" in line
