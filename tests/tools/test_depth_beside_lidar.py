from __future__ import annotations

import os
import threading
import time

import pytest

from drivers.rplidar import open_rplidar
from tools.config import parse
from tools.depth_bench import STAGES
from tools.depth_beside_lidar import bench_depth_beside_lidar, emulated_lidar
from tools.processes import in_own_process

CONFIG = parse({"depth": {"width": 424, "height": 240, "fps": 15}}, "test")


@pytest.mark.live
def test_camera_and_lidar_are_measured_at_once():
    allowed = os.sched_getaffinity(0)
    both = in_own_process(bench_depth_beside_lidar, "numpy", CONFIG, 2.0)
    assert both.depth.frames + both.depth.lost_frames == pytest.approx(15 * both.depth.seconds, abs=4)
    assert both.lidar.scans == pytest.approx(10 * both.depth.seconds, abs=4)
    assert set(both.depth.cpu_share) == set(STAGES)
    parts = sum(both.depth.cpu_share.values()) + sum(both.lidar.cpu_share.values())
    assert min(both.depth.cpu_share.values()) > 0.0
    assert both.lidar.cpu_share["lidar: SLAM"] > 0.0
    assert parts + both.others_share == pytest.approx(both.depth.process_share, abs=0.03)
    assert both.lidar.latency_ms.median > 0.0
    assert both.cores <= 2
    assert os.sched_getaffinity(0) == allowed


@pytest.mark.live
def test_the_emulated_lidar_ends_with_its_block():
    with emulated_lidar() as port, open_rplidar(port) as lidar:
        assert lidar.info().model == "A2M8"
    deadline = time.monotonic() + 10.0
    while os.path.exists(port) and time.monotonic() < deadline:  # noqa: PTH110 - a device, not a file
        threading.Event().wait(0.05)
    assert not os.path.exists(port)  # noqa: PTH110
