from __future__ import annotations

import json

import numpy as np

from drivers.messages import LaserScan
from drivers.rplidar_decoder import DecoderCounters
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.config import Config
from tools.pipeline import MappingFlow
from tools.results import decoding_summary, grid_snapshot, new_run_folder, save_results


def flow_of_one_scan():
    flow = MappingFlow(Config(), Config().mount())
    angles = -np.linspace(0, 2 * np.pi, 200, endpoint=False)
    flow.feed(LaserScan(5_000_000_000, angles, np.full(200, 2.0), np.zeros(200), 0.1, 12.0))
    return flow


def test_results_of_a_run_are_all_there(tmp_path):
    report = save_results(tmp_path, flow_of_one_scan(), "somewhere", {"more": 1})
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"map.yaml", "map.pgm", "map.npz", "map.png", "trajectory.tum", "report.json"}
    assert json.loads((tmp_path / "report.json").read_text()) == report
    assert report["scans"]["mapped"] == 1
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
