from __future__ import annotations

import time

import pytest

from drivers.rplidar_protocol import Answer
from tools.lidar_peers import PEERS, can_decode, installed_peers, measured_share, peer_rate
from tools.lidar_streams import STREAM_KINDS, encoded_stream


def test_only_peers_that_are_there_are_named():
    assert set(installed_peers()) <= set(PEERS)


def test_no_peer_reads_dense_capsules_rightly():
    assert not any(can_decode(peer, Answer.DENSE) for peer in PEERS)
    assert all(can_decode(peer, Answer.NODES) for peer in PEERS)


@pytest.mark.parametrize("peer", PEERS)
def test_a_peer_that_is_there_decodes(peer):
    if peer not in installed_peers():
        pytest.skip(f"{peer} is not installed (extra bench)")
    for kind in STREAM_KINDS:
        if can_decode(peer, kind.answer):
            assert peer_rate(peer, kind.answer, encoded_stream(kind, 5000, 0).tobytes()) > 1000


def test_a_share_counts_what_came_while_it_was_measured():
    def ticks():
        while True:
            time.sleep(0.001)
            yield 1

    share, count = measured_share(ticks(), 0.01, 0.1)
    assert 0.0 <= share < 1.0
    assert 10 <= count <= 128
