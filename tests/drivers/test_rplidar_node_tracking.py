from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.rplidar_capsules import Packets, decode_nodes, ultra_offset_q16
from drivers.rplidar_encoding import encode_nodes
from drivers.rplidar_framing import PacketFinder
from drivers.rplidar_node_tracking import LOCK_FRAMES
from drivers.rplidar_protocol import Answer

COUNT = 400
READINGS = ("as a real A2", "with a guess for no distance", "plain")


def nodes(reading: str, seed: int = 0, step_q6: int = 115) -> Packets:
    """Nodes of a room with edges and holes, their angles written in one of the ways that sensors have."""
    random = np.random.default_rng(seed)
    head_q6 = np.arange(COUNT) * step_q6 + 500
    distance_q2 = np.repeat(random.integers(1500, 20000, COUNT // 8), 8) + random.integers(-20, 20, COUNT)
    distance_q2[random.random(COUNT) < 0.1] = 0
    offset_q6 = ultra_offset_q16(distance_q2) >> 10
    if reading == "plain":
        offset_q6[:] = 0
    elif reading == "as a real A2":
        offset_q6[distance_q2 == 0] = 0
    flag = np.diff(head_q6 // 23040, prepend=0) > 0
    return encode_nodes((head_q6 - offset_q6) % 23040, distance_q2, np.full(COUNT, 15), flag)


def found(data: bytes, cuts: list[int] | None = None) -> list[bytes]:
    """The nodes that a finder gives, fed in pieces."""
    finder, pending, rows = PacketFinder(Answer.NODES), b"", []
    for start, stop in zip([0, *(cuts or [])], [*(cuts or []), len(data)], strict=True):
        pending += data[start:stop]
        framing = finder.find(pending)
        rows += [row.tobytes() for run in framing.runs for row in run.packets]
        pending = pending[framing.used :]
    return rows


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("step_q6", [58, 115, 173])
def test_sound_nodes_are_found_whatever_their_angles_mean(reading: str, step_q6: int) -> None:
    sent = [row.tobytes() for row in nodes(reading, step_q6=step_q6)]
    rows = found(b"".join(sent))
    # Which way it is shows at the first hole: that node may be lost.
    assert len(rows) >= COUNT - 3
    assert set(rows) <= set(sent)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_the_same_nodes_however_the_bytes_are_cut(data) -> None:
    clean = nodes(data.draw(st.sampled_from(READINGS)), data.draw(st.integers(0, 99))).tobytes()
    random = np.random.default_rng(data.draw(st.integers(0, 999)))
    kept = np.frombuffer(clean, dtype=np.uint8)[random.random(len(clean)) > 0.003].copy()
    hit = random.random(len(kept)) < 0.003
    kept[hit] = random.integers(0, 256, hit.sum())
    cuts = sorted(data.draw(st.lists(st.integers(0, len(kept)), max_size=30)))
    assert found(kept.tobytes(), cuts) == found(kept.tobytes())


@given(st.integers(60 * 5, COUNT * 5 - 60), st.integers(1, 255), st.sampled_from(READINGS))
@settings(deadline=None)
def test_one_changed_byte_costs_two_nodes_at_most_and_no_angle(place: int, change: int, reading: str) -> None:
    clean = nodes(reading)
    data = bytearray(clean.tobytes())
    data[place] ^= change
    rows = found(bytes(data))
    sent = [row.tobytes() for row in clean]
    undamaged = found(clean.tobytes())
    assert len(rows) >= len(undamaged) - 2
    strangers = [row for row in rows if row not in sent]
    assert len(strangers) <= 1
    for strange in strangers:
        angle = decode_nodes(np.frombuffer(strange, dtype=np.uint8).reshape(1, 5)).angle_q6[0]
        off = (angle - decode_nodes(clean).angle_q6[place // 5] + 11520) % 23040 - 11520
        assert abs(off) <= 2 * 64


@given(st.integers(60 * 5, COUNT * 5 - 60), st.sampled_from(READINGS), st.integers(-1, 255))
@settings(deadline=None)
def test_a_byte_lost_or_added_costs_two_nodes_and_falsifies_none(place: int, reading: str, added: int) -> None:
    clean = nodes(reading)
    data = bytearray(clean.tobytes())
    if added < 0:
        del data[place]
    else:
        data.insert(place, added)
    rows = found(bytes(data))
    assert set(rows) <= {row.tobytes() for row in clean}
    assert len(rows) >= len(found(clean.tobytes())) - 2


@given(st.integers(30, COUNT - 60), st.sampled_from([(a, b) for b in range(5) for a in range(b)]), st.booleans())
@settings(deadline=None)
def test_two_bytes_lost_or_added_in_one_node_cost_two_nodes(node: int, places: tuple[int, int], lost: bool) -> None:
    clean = nodes("as a real A2", seed=1)
    data = bytearray(clean.tobytes())
    for place in reversed(places):
        at = 5 * node + place
        data[at : at + lost] = b"" if lost else b"\x55"
    rows = found(bytes(data))
    assert len(rows) >= len(found(clean.tobytes())) - 2
    assert len(set(rows) - {row.tobytes() for row in clean}) <= 1


@given(st.integers(30, COUNT - 60), st.integers(1, 3), st.integers(0, 4), st.integers(0, 4), st.integers(-1, 255))
@settings(deadline=None)
def test_two_damaged_nodes_cost_four_however_few_lie_between(
    node: int, between: int, place: int, later: int, added: int
) -> None:
    clean = nodes("as a real A2", seed=1)
    data = bytearray(clean.tobytes())
    for at in (5 * (node + between + 1) + later, 5 * node + place):
        data[at : at + (added < 0)] = b"" if added < 0 else bytes([added])
    assert len(found(bytes(data))) >= len(found(clean.tobytes())) - 4


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_not_locked_on_to(seed: int) -> None:
    assert not found(np.random.default_rng(seed).bytes(200_000))


@pytest.mark.parametrize(("node", "sound"), [("3E412D4913", True), ("3C412D4913", False), ("3F412D4913", False),
                                             ("3E402D4913", False)])  # fmt: skip
def test_check_bits(node: str, sound: bool) -> None:
    """The datasheet's two checks, on a node at 90.5 deg and 1234.25 mm among others that turn."""
    angle_q6 = 5792 + 115 * (np.arange(40) - 20)
    rows = encode_nodes(angle_q6, np.full(40, 4937), np.full(40, 15), np.zeros(40, dtype=np.bool_))
    rows[20] = list(bytes.fromhex(node))
    assert (bytes.fromhex(node) in found(rows.tobytes())) == sound
    assert len(found(rows.tobytes())) == 38 + sound


def test_a_head_that_jumps_is_found_again() -> None:
    rows = nodes("plain")
    jumped = np.concatenate((rows[:100], rows[250:]))
    # A chain is needed, whose first node only vouches; the last before the jump has no successor.
    assert len(found(jumped.tobytes())) >= len(jumped) - 4
    assert LOCK_FRAMES < 100
