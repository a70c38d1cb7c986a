from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import mapping.front_end
from drivers.errors import RecordingError
from drivers.messages import LaserScan
from drivers.recording_reader import open_recording
from mapping.trajectory import Trajectory
from tools.pipeline import LidarDecoding
from tools.processes import in_own_process
from tools.replay_run import recorded_config, replay_recording
from tools.simulated_drive import record_round_trip
from tools.slam_bench import (
    GRAPH,
    LINES,
    MATCH,
    REFINE,
    STAGES,
    TO_GRAPH,
    bench_slam,
    score_by_relations,
)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """60 turns of a simulated A2."""
    path = tmp_path_factory.mktemp("bench") / "drive.mcap"
    record_round_trip(path, 60)
    return path


@pytest.fixture(scope="module")
def cost(drive):
    return in_own_process(bench_slam, drive, None, ())


def test_the_stages_add_up_to_the_time_to_map_over_the_duration(cost):
    by_name = {stage.name: stage for stage in cost.stages}
    assert tuple(by_name) == STAGES
    for stage in (MATCH, LINES, GRAPH, REFINE):
        assert by_name[stage].cpu_s > 0.0, stage
    assert sum(by_name[name].cpu_s for name in TO_GRAPH) == pytest.approx(cost.tau_graph.cpu * cost.duration_s)
    assert sum(stage.wall_s for stage in cost.stages) == pytest.approx(cost.tau.wall * cost.duration_s)
    assert cost.tau.cpu > cost.tau_graph.cpu
    assert by_name[MATCH].cpu_ms_per_scan == pytest.approx(by_name[MATCH].cpu_s * 1e3 / cost.scans)


def test_what_was_measured_is_said(cost):
    assert cost.simulated
    assert cost.scans == 60
    assert abs(cost.samples - 800) < 10
    assert cost.scan_period_ms == pytest.approx(100.0, rel=0.02)
    assert cost.duration_s == pytest.approx(5.9, rel=0.02)
    assert cost.score is None
    assert cost.scan_cpu_ms.median <= cost.scan_cpu_ms.p99 <= cost.scan_cpu_ms.max


def test_memory_is_counted_where_the_system_tells(cost):
    if math.isnan(cost.memory_start.peak_mb):
        pytest.skip("no /proc here")
    assert 0 < cost.memory_start.resident_mb <= cost.memory_graph.peak_mb
    assert cost.memory_graph.resident_mb <= cost.memory_graph.peak_mb


def test_timing_changes_nothing_of_the_map(drive, cost, tmp_path):
    before = vars(mapping.front_end)["match_groups"]
    measured = bench_slam(drive, None)
    assert vars(mapping.front_end)["match_groups"] is before
    with open_recording(drive) as recording:
        report = replay_recording(recording, recorded_config(recording), tmp_path, on_progress=lambda _: None)
    assert measured.keyframes == cost.keyframes == report["slam"]["keyframes"]
    assert measured.length_m == cost.length_m
    assert round(cost.length_m, 3) == report["trajectory"]["length_m"]


def test_relations_of_another_log_do_not_score(tmp_path):
    trajectory = Trajectory(np.array([1, 2], dtype=np.int64) * 10**9, np.array([[0.0, 0, 0], [1.1, 0, 0]]))
    mine, other = tmp_path / "mine.relations", tmp_path / "other.relations"
    mine.write_text("1.0 2.0 1.0 0 0 0 0 0\n")
    other.write_text("7.0 8.0 1.0 0 0 0 0 0\n")
    assert score_by_relations(trajectory, (other,)) is None
    score = score_by_relations(trajectory, (other, mine))
    assert score is not None
    assert score.relations == 1
    assert score.mean_m == pytest.approx(0.1)


def test_scans_without_a_measurement_are_refused(tmp_path, drive):
    from drivers.recording_writer import McapRecorder

    path = tmp_path / "blind.mcap"
    decoding = LidarDecoding()
    with open_recording(drive) as recording, McapRecorder(path, metadata={}) as blind:
        for message in recording.messages():
            for decoded in decoding.feed(message):
                if isinstance(decoded, LaserScan):
                    blind.put(replace(decoded, ranges_m=np.zeros(len(decoded.ranges_m)), intensities=None))
    with pytest.raises(RecordingError, match="fewer than two scans"):
        bench_slam(path, None)
