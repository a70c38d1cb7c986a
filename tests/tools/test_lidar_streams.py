from __future__ import annotations

import numpy as np
import pytest

from drivers.rplidar_decoder import RplidarDecoder
from drivers.rplidar_protocol import PACKET_SAMPLES
from tools.lidar_streams import STREAM_KINDS, encoded_stream, live_chunks


@pytest.mark.parametrize("kind", STREAM_KINDS, ids=lambda kind: kind.name)
def test_a_stream_is_a_room_seen_ten_times_a_second(kind):
    packets = encoded_stream(kind, 20_000, seed=4)
    assert len(packets) * PACKET_SAMPLES[kind.answer] >= 20_000
    decoder = RplidarDecoder(kind.description)
    chunks = live_chunks(kind, packets.tobytes(), 0.02)
    scans = [scan for chunk in chunks for scan in decoder.feed(chunk)]
    assert b"".join(chunk.data for chunk in chunks) == packets.tobytes()
    assert decoder.counters.samples > 19_700
    # Which way standard nodes write their angles shows at the first sample without a distance.
    assert decoder.counters.rejected_packets <= (1 if kind.name.startswith("standard") else 0)
    whole = [scan for scan in scans if scan.complete]
    assert len(whole) >= len(scans) - 2
    periods = np.diff([scan.stamp_ns for scan in scans[2:]]) * 1e-9
    assert np.median(periods) == pytest.approx(0.1, rel=0.05)
    assert all(0.9 < scan.valid.mean() < 1.0 for scan in whole)


def test_a_seed_is_a_stream():
    kind = STREAM_KINDS[1]
    same = [encoded_stream(kind, 1000, seed).tobytes() for seed in (1, 1, 2)]
    assert same[0] == same[1] != same[2]
