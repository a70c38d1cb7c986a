"""`bench`: the group, its short form, and `bench slam` from end to end."""

from __future__ import annotations

import json

import pytest

from tools.depth_bench import projections


def test_a_recording_alone_is_measured_by_the_pipeline_bench(round_trip, cli):
    short, long = cli("bench", round_trip, "--json"), cli("bench", "pipeline", round_trip, "--json")
    assert short.code == long.code == 0
    assert json.loads(short.out).keys() == json.loads(long.out).keys()
    assert json.loads(cli("bench", "--json", round_trip).out)["scans"] == 40


@pytest.mark.live
def test_slam_is_measured_beside_peers_and_at_the_real_pace(round_trip, cli):
    ended = cli("bench", "slam", round_trip, "--live", "2", "--json")
    assert ended.code == 0, ended.err
    (report,) = json.loads(ended.out)["logs"]
    assert report["slam"]["simulated"] is True
    assert report["live"]["mapped"] > 10
    assert [peer["name"].partition(",")[0] for peer in report["peers"]] == [
        "kiss-icp alone", "kiss-icp alone", "MRPT icp-slam",
    ]  # fmt: skip
    assert report["peers"][2]["cpu_ms_per_scan"] is None  # not installed, or no CARMEN log


def test_a_simulated_drive_is_measured_and_labelled(cli):
    ended = cli("bench", "slam", "--simulate", "40", "--live", "1")
    assert ended.code == 0, ended.err
    assert ended.out.count("SIMULATED") == 2
    for text in ("joint refinement", "time to map / duration", "resident memory", "scan in to pose out", "MRPT"):
        assert text in ended.out


def test_nothing_to_measure_is_wrong_use(cli):
    ended = cli("bench", "slam")
    assert ended.code == 2
    assert "--simulate" in ended.error_lines[0]


def test_what_is_no_recording_is_one_line(cli, tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"no recording")
    ended = cli("bench", "slam", tmp_path / "a.mcap", "--no-peers")
    assert ended.code == 1
    assert len(ended.error_lines) == 1
    assert "a.mcap" in ended.err


@pytest.mark.live
@pytest.mark.parametrize("lidar", [True, False])
def test_depth_is_measured_with_each_projection_that_there_is_beside_a_lidar_or_alone(lidar, cli, tmp_path):
    config = tmp_path / "small.yaml"
    config.write_text("depth: {width: 424, height: 240, fps: 15}\n", encoding="utf-8")
    options = ["--seconds", "1", "--config", config, "--lidar" if lidar else "--no-lidar", "--json"]
    ended = cli("bench", "depth", *options)
    assert ended.code == 0, ended.err
    report = json.loads(ended.out)
    assert report["simulated"] is True
    assert [cost["projection"] for cost in report["costs"]] == [*projections()]
    assert all(cost["frames"] > 5 for cost in report["costs"])
    assert [each["scans"] > 3 for each in report["lidar"]] == [True] * (len(report["costs"]) if lidar else 0)
