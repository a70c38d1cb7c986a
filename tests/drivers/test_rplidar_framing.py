from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rplidar_capsules import Packets, decode_nodes
from drivers.rplidar_encoding import encode_nodes, encode_ultra
from drivers.rplidar_framing import PacketFinder
from drivers.rplidar_node_tracking import LOCK_FRAMES
from drivers.rplidar_protocol import Answer


def turning_nodes(count: int, seed: int = 0) -> Packets:
    random = np.random.default_rng(seed)
    angle = np.arange(count) * 115
    turn = np.diff(angle // 23040, prepend=0) > 0
    return encode_nodes(angle % 23040, random.integers(600, 40000, count), np.full(count, 15), turn)


def ultra(count: int, seed: int = 0) -> Packets:
    distance = np.random.default_rng(seed).integers(200, 9000, count * 96 + 1)
    return encode_ultra(np.arange(count) * 2765 % 23040, distance, np.zeros(count, dtype=np.bool_))


@given(st.integers(0, 131), st.integers(1, 255), st.integers(0, 2**16))
def test_any_changed_byte_rejects_its_capsule(place: int, change: int, seed: int) -> None:
    clean = ultra(3, seed).tobytes()
    data = bytearray(clean)
    data[132 + place] ^= change
    framing = PacketFinder(Answer.ULTRA).find(bytes(data))
    sound = b"".join(run.packets.tobytes() for run in framing.runs)
    assert clean[132:264] not in sound
    assert bytes(data[132:264]) not in sound
    assert sound.startswith(clean[:132])


def test_capsules_are_found_again_after_loss() -> None:
    data = ultra(6).tobytes()
    framing = PacketFinder(Answer.ULTRA).find(data[50:300] + data[301:])
    # The lone one at 82 is of no use: its samples need the next, and out of step that is its only witness too.
    assert [(run.start, len(run.packets)) for run in framing.runs] == [(345, 3)]
    assert framing.used == len(data) - 51


def test_nodes_lock_on_inside_noise() -> None:
    noise = np.random.default_rng(5).integers(0, 256, 3000, dtype=np.uint8).tobytes()
    nodes = turning_nodes(60)
    framing = PacketFinder(Answer.NODES).find(noise + nodes.tobytes())
    assert len(framing.runs) == 1
    assert framing.runs[0].start == 3005  # the first vouches for the second
    assert np.array_equal(framing.runs[0].packets, nodes[1:59])  # the last waits for its successor


@pytest.mark.parametrize("cut", range(1, 25))
def test_nodes_after_lost_bytes_are_not_misread(cut: int) -> None:
    nodes = turning_nodes(80, seed=cut)
    data = nodes.tobytes()
    framing = PacketFinder(Answer.NODES).find(data[:100] + data[100 + cut :])
    found = np.concatenate([run.packets for run in framing.runs])
    known = {row.tobytes() for row in nodes}
    assert all(row.tobytes() in known for row in found)
    assert len(found) >= 80 - cut // 5 - 4


def test_a_constant_world_does_not_lock_one_byte_off() -> None:
    count = 200
    nodes = encode_nodes(
        np.arange(count) * 115, np.full(count, 0x0DB5), np.full(count, 15), np.zeros(count, dtype=np.bool_)
    )
    for shift in range(1, 5):
        framing = PacketFinder(Answer.NODES).find(nodes.tobytes()[shift:])
        assert framing.runs[0].start == 10 - shift


def test_a_turn_flag_far_from_zero_is_noise() -> None:
    angle = np.arange(40) * 115 + 5000
    flags = np.zeros(40, dtype=np.bool_)
    flags[20] = True
    nodes = encode_nodes(angle, np.full(40, 4000), np.full(40, 15), flags)
    framing = PacketFinder(Answer.NODES).find(nodes.tobytes())
    assert not np.concatenate([decode_nodes(run.packets).new_turn for run in framing.runs]).any()


def test_less_than_a_chain_stays_open() -> None:
    data = turning_nodes(LOCK_FRAMES).tobytes()[:-1]
    framing = PacketFinder(Answer.NODES).find(data)
    assert (framing.runs, framing.used) == ([], 0)


@pytest.mark.real_data
def test_one_real_turn_of_nodes(data_dir: Path) -> None:
    data = (data_dir / "rplidar_wire" / "goblimey_A2_legacy_scan_nodes.bin").read_bytes()
    framing = PacketFinder(Answer.NODES).find(data)
    assert [(run.start, len(run.packets)) for run in framing.runs] == [(0, 299)]
    samples = decode_nodes(framing.runs[0].packets)
    assert np.flatnonzero(samples.new_turn).tolist() == [0]
    assert samples.distance_q2[:4].tolist() == [0, 2881, 2915, 2016]
