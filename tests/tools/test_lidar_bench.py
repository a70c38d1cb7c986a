from __future__ import annotations

import pytest

from tools.lidar_bench import READS_S, decoding_speeds, live_shares
from tools.lidar_peers import installed_peers
from tools.lidar_streams import STREAM_KINDS


def test_every_answer_type_is_measured_beside_the_peers_that_are_there():
    speeds = decoding_speeds(10_000, seed=0)
    assert [speed.stream for speed in speeds] == [kind.name for kind in STREAM_KINDS]
    for speed in speeds:
        assert tuple(speed.by_read_s) == READS_S
        assert min(speed.by_read_s.values()) > 0
        assert tuple(speed.peers) == installed_peers()


@pytest.mark.live
def test_the_driver_is_measured_at_the_sensor_s_rate():
    share = live_shares(1.0)[0]
    assert share.driver == "mapfuse-robot"
    assert share.samples_per_s == pytest.approx(16_000, rel=0.2)
    assert 0.0 < share.cpu_share < 1.0
