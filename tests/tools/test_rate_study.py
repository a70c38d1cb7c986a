from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from drivers.recording_reader import open_recording
from mapping import se2
from mapping.relations import Relations
from mapping.trajectory import read_tum
from tools.config import Config
from tools.plots import draw_rate_maps, draw_real_time_factors
from tools.rate_study import study_rates
from tools.replay_run import recorded_config, replay_recording
from tools.simulated_drive import record_round_trip


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """80 turns of a simulated A2."""
    path = tmp_path_factory.mktemp("rates") / "drive.mcap"
    record_round_trip(path, 80)
    return path


def study(path, relations=None, every=(1, 4), config=None):
    with open_recording(path) as recording:
        return study_rates(recording, config or recorded_config(recording), (8, 20), every, relations, lambda _: None)


@pytest.fixture(scope="module")
def maps(drive):
    return study(drive)


def test_every_pair_of_rate_and_resolution_is_a_map(maps):
    assert [(each.scan_every, each.cells_per_meter) for each in maps] == [(1, 8), (1, 20), (4, 8), (4, 20)]
    full, rare = maps[0], maps[2]
    assert full.rate_hz == pytest.approx(10.0, rel=0.02)
    assert rare.rate_hz == pytest.approx(2.5, rel=0.02)
    assert full.scans == pytest.approx(4 * rare.scans, abs=4)
    for coarse, fine in (maps[:2], maps[2:]):
        assert fine.grid.resolution_m == 0.05
        assert np.array(fine.map_size) == pytest.approx(np.array(coarse.map_size) * 2.5, rel=0.05)
        assert fine.tau > 0.0
    assert all(not each.failures for each in maps)
    assert min(each.agreement for each in maps) > 0.95


def test_a_map_of_the_study_is_the_map_of_a_replay(drive, maps, tmp_path):
    with open_recording(drive) as recording:
        config = recorded_config(recording).with_slam(loop_closure=None, refine=None, scan_every=4)
        replay_recording(recording, config, tmp_path, on_progress=lambda _: None)
    with np.load(tmp_path / "map.npz") as saved:
        np.testing.assert_array_equal(saved["log_odds"], maps[3].grid.log_odds)


def test_true_relations_decide_and_are_interpolated(drive, tmp_path):
    with open_recording(drive) as recording:
        replay_recording(recording, recorded_config(recording), tmp_path, on_progress=lambda _: None)
    mapped = read_tum(tmp_path / "trajectory.tum")
    first, second = mapped.stamps_ns[[10, 20]], mapped.stamps_ns[[60, 70]]
    poses = se2.between(mapped.poses[[10, 20]], mapped.poses[[60, 70]])
    good = study(drive, Relations(first, second, poses), every=(4,))
    assert good[0].error_m < 0.05
    assert not good[0].failures
    bad = study(drive, Relations(first, second, poses + np.array([1.0, 0.0, 0.0])), every=(4,))
    assert bad[0].error_m == pytest.approx(1.0, abs=0.05)
    assert bad[0].failures == bad[1].failures
    assert "error" in bad[0].failures[0]


def test_a_map_that_no_scan_came_into_is_a_failed_one(drive):
    blind = Config().model_copy(update={"odometry": Config().odometry.model_copy(update={"min_points": 100_000})})
    failed = study(drive, every=(4,), config=blind)
    assert failed[0].failures
    assert failed[0].scans == 0


def is_red(image):
    blue, green, red = (image[..., channel].astype(int) for channel in range(3))
    return (red > 150) & (green < 80) & (blue < 80)


def test_failed_maps_are_red_in_both_pictures(maps, tmp_path):
    failed = [replace(each, failures=("tracking lost 2 times",)) if each.scan_every == 4 else each for each in maps]
    for name, draw in (("maps", draw_rate_maps), ("tau", draw_real_time_factors)):
        draw(tmp_path / f"{name}_good.png", maps, "good")
        draw(tmp_path / f"{name}_bad.png", failed, "bad")
        good, bad = (cv2.imread(str(tmp_path / f"{name}_{which}.png")) for which in ("good", "bad"))
        assert is_red(good).sum() < 20
        assert is_red(bad).sum() > 200


def test_the_command_writes_pictures_and_table(drive, cli, tmp_path):
    ended = cli(
        "evaluate", "rates", drive, "-o", tmp_path / "study", "--cells-per-meter", "12,8", "--scan-every", "8", "--json"
    )
    assert ended.code == 0, ended.err
    report = json.loads(ended.out)
    assert report["simulated"] is True
    assert [row["cells_per_meter"] for row in report["maps"]] == [8, 12]
    assert json.loads((tmp_path / "study/report.json").read_text()) == report
    for name in ("maps.png", "tau.png"):
        assert cv2.imread(str(tmp_path / "study" / name)) is not None
    text = cli("evaluate", "rates", drive, "-o", tmp_path / "again", "--cells-per-meter", "8", "--scan-every", "8").out
    assert "SIMULATED" in text


@pytest.mark.parametrize(
    ("option", "value"), [("--cells-per-meter", "8,x"), ("--scan-every", "0"), ("--scan-every", "1.5")]
)
def test_lists_that_make_no_sense_are_refused(option, value, drive, cli, tmp_path):
    ended = cli("evaluate", "rates", drive, "-o", tmp_path / "study", option, value)
    assert ended.code == 2
    assert len(ended.error_lines) == 1
    assert option in ended.err
    assert not (tmp_path / "study").exists()
