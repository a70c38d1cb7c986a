"""Decoding against hand-computed vectors (printed alike by Slamtec's SDK 2.1) and against bytes of real sensors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from drivers.rplidar_capsules import (
    VBS_MM,
    Packets,
    Samples,
    decode_dense,
    decode_express,
    decode_nodes,
    decode_ultra,
    start_q6,
    ultra_offset_q16,
)
from drivers.rplidar_encoding import encode_dense, encode_express, encode_ultra
from drivers.rplidar_framing import PacketFinder
from drivers.rplidar_protocol import Answer


def packets(*rows: bytes) -> Packets:
    return np.array([list(row) for row in rows], dtype=np.uint8)


def sdk_angles_q14(samples: Samples) -> list[int]:
    """Angles as the SDK stores them: 90 deg = 16384."""
    return [(angle << 8) // 90 for angle in samples.angle_q6.tolist()]


def test_standard_nodes() -> None:
    rows = [bytes.fromhex(text) for text in ("3D412D4913", "0203000000", "FEFFB3FFFF")]
    samples = decode_nodes(packets(*rows))
    assert samples.new_turn.tolist() == [True, False, False]
    assert samples.quality is not None
    assert samples.quality.tolist() == [15, 0, 63]
    assert (samples.angle_q6 / 64).tolist() == [90.5, 0.015625, 359.984375]
    assert (samples.distance_q2 / 4).tolist() == [1234.25, 0, 16383.75]


def test_express_capsule() -> None:
    first = bytes.fromhex("A85F0080 A00F401F00 D30700005C") + bytes(70)
    second = bytes.fromhex("A7533007") + bytes(80)
    pair = packets(first, second)
    samples = decode_express(pair)
    assert samples.angle_q6[:4].tolist() == [0, 57, 22675, 132]
    assert (samples.distance_q2[:4] / 4).tolist() == [1000, 2000, 500, 0]
    assert sdk_angles_q14(samples)[:4] == [0, 162, 64497, 375]
    assert (pair[:, 3] >> 7).tolist() == [1, 0]
    assert [start_q6(pair, place) / 64 for place in range(2)] == [0, 28.75]
    assert samples.quality is None


def test_express_turn_begins_with_the_last_sample_before_zero() -> None:
    start = np.array([340 * 64, 560])
    pair = encode_express(start, np.full((2, 32), 1000), np.zeros((2, 32), dtype=np.int64), np.zeros(2, dtype=np.bool_))
    samples = decode_express(pair)
    assert np.flatnonzero(samples.new_turn).tolist() == [22]
    assert (samples.angle_q6[22:24] / 64).tolist() == pytest.approx([359.76, 0.65], abs=0.02)


def test_ultra_capsule() -> None:
    first = bytes.fromhex("A052408B F452C0FE E804E07F") + bytes(120)
    second = bytes.fromhex("A4554014") + bytes(128)
    samples = decode_ultra(packets(first, second))
    assert (samples.distance_q2[:6] / 4).tolist() == [1000, 1010, 1990, 2000, 0, 0]
    assert sdk_angles_q14(samples)[:6] == [6977, 7045, 6994, 7062, 7099, 7168]


def test_dense_capsule() -> None:
    distances = np.zeros((2, 40), dtype=np.int64)
    distances[0, [0, 2]] = 1500, 12000
    samples = decode_dense(encode_dense(np.array([640, 1216]), distances, np.zeros(2, dtype=np.bool_)))
    assert sdk_angles_q14(samples)[:3] == [1820, 1860, 1900]
    assert (samples.distance_q2[:3] / 4).tolist() == [1500, 0, 12000]


def test_variable_bit_scale() -> None:
    codes = [511, 512, 513, 1279, 1280, 1281, 1791, 1792, 1793, 3327, 3328, 3329, 4095]
    expected = [511, 512, 514, 2046, 2048, 2052, 4092, 4096, 4104, 16376, 16384, 16400, 28656]
    assert VBS_MM[codes].tolist() == expected


def test_ultra_offset_follows_the_distance() -> None:
    distance_q2 = np.array([0, 1000, 4000, 8000, 20000, 48000])
    degrees = ultra_offset_q16(distance_q2) / 65536
    assert degrees.tolist() == pytest.approx([7.5, 2.51, 6.6566, 7.3281, 7.7757, 7.8876], abs=0.005)


def test_a_turn_that_ends_on_a_packet_edge_is_not_missed() -> None:
    # 36.5 deg from 323.5 to exactly 0: the rounded-down step of the interpolation stays below 360 deg.
    start = np.array([20704, 0, 2336])
    rows = encode_ultra(start, np.full(96 * 3 + 1, 1000), np.zeros(3, dtype=np.bool_))
    assert np.flatnonzero(decode_ultra(rows).new_turn).tolist() == [95]


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("key", "kind"), [("test_capsule_parsing", Answer.EXPRESS), ("test_ultra_capsule_parsing", Answer.ULTRA)]
)
def test_real_capsules_decode_as_the_sdk_does(data_dir: Path, key: str, kind: Answer) -> None:
    case = json.loads((data_dir / "rplidar_wire" / "hyunje_capsules.json").read_text())[key]
    framing = PacketFinder(kind).find(bytes.fromhex("".join(case["packets_hex"])))
    assert [len(run.packets) for run in framing.runs] == [5]
    samples = (decode_express if kind == Answer.EXPRESS else decode_ultra)(framing.runs[0].packets)
    nodes = np.array([node for packet in case["nodes_sdk"][:4] for node in packet])
    assert sdk_angles_q14(samples) == nodes[:, 2].tolist()
    assert samples.distance_q2.tolist() == nodes[:, 3].tolist()
    assert samples.new_turn.tolist() == (nodes[:, 0] == 1).tolist()
