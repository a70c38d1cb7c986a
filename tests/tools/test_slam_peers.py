from __future__ import annotations

import numpy as np
import pytest

from drivers.recording_reader import open_recording
from mapping import se2
from mapping.trajectory import read_tum
from tools.replay_run import recorded_config, replay_recording
from tools.simulated_drive import record_round_trip
from tools.slam_peers import bench_own_kiss_icp, bench_stock_kiss_icp


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A simulated drive of 5 s, and relations between poses of its replay."""
    folder = tmp_path_factory.mktemp("peers")
    path = folder / "drive.mcap"
    record_round_trip(path, 50)
    with open_recording(path) as recording:
        replay_recording(recording, recorded_config(recording), folder, on_progress=lambda _: None)
    mapped = read_tum(folder / "trajectory.tum")
    lines = []
    for first, second in ((2, 20), (10, 40), (2, 45)):
        x, y, yaw = se2.between(mapped.poses[first], mapped.poses[second]).tolist()
        stamps = " ".join(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in mapped.stamps_ns[[first, second]])
        lines.append(f"{stamps} {x} {y} 0 0 0 {yaw}\n")
    relations = folder / "replay.relations"
    relations.write_text("".join(lines))
    return path, (relations,)


# The stock pipeline keeps one point a metre, which is rough for a room.
@pytest.mark.parametrize(
    ("bench", "most_m", "most_deg"), [(bench_own_kiss_icp, 0.1, 3.0), (bench_stock_kiss_icp, 0.5, 10.0)]
)
def test_kiss_icp_alone_follows_a_short_drive(bench, most_m, most_deg, drive):
    path, relations = drive
    cost = bench(path, None, relations)
    assert cost.score.relations == 3
    assert cost.score.mean_m < most_m
    assert cost.score.mean_deg < most_deg
    assert cost.cpu_ms_per_scan > 0.0
    assert cost.tau_cpu == pytest.approx(cost.cpu_ms_per_scan * 50 / 1e3 / 4.9, rel=0.03)


def test_the_two_are_not_the_same(drive):
    path, relations = drive
    own, stock = bench_own_kiss_icp(path, None, relations), bench_stock_kiss_icp(path, None, relations)
    assert not np.isclose(own.score.mean_m, stock.score.mean_m)
    assert own.name != stock.name
