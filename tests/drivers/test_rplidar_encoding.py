from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.rplidar_capsules import (
    VBS_SHIFT,
    decode_dense,
    decode_express,
    decode_nodes,
    decode_ultra,
    start_q6,
    ultra_offset_q16,
)
from drivers.rplidar_encoding import (
    MAX_PREDICTION,
    encode_dense,
    encode_express,
    encode_nodes,
    encode_ultra,
    vbs_code,
)
from drivers.rplidar_framing import PacketFinder
from drivers.rplidar_protocol import Answer

SEED = st.integers(0, 2**32 - 1)
NO_RESTART = np.zeros(3, dtype=np.bool_)


@given(SEED)
def test_nodes_round_trip(seed: int) -> None:
    random = np.random.default_rng(seed)
    angle, distance = random.integers(0, 23040, 50), random.integers(0, 65536, 50)
    quality, turn = random.integers(0, 64, 50), random.random(50) < 0.5
    samples = decode_nodes(encode_nodes(angle, distance, quality, turn))
    assert samples.quality is not None
    assert np.array_equal(samples.angle_q6, angle)
    assert np.array_equal(samples.distance_q2, distance)
    assert np.array_equal(samples.quality, quality)
    assert np.array_equal(samples.new_turn, turn)


@given(SEED)
def test_express_round_trip(seed: int) -> None:
    random = np.random.default_rng(seed)
    start = np.array([0, 32 * 58, 64 * 58])
    distance, correction = random.integers(0, 16384, (3, 32)), random.integers(0, 64, (3, 32))
    rows = encode_express(start, distance, correction, NO_RESTART)
    samples = decode_express(rows)
    assert np.array_equal(samples.distance_q2, distance[:2].reshape(-1) * 4)
    expected = (np.arange(64) * 58 - correction[:2].reshape(-1) * 8) % 23040
    assert np.array_equal(samples.angle_q6, expected)
    assert PacketFinder(Answer.EXPRESS).find(rows.tobytes()).used == rows.size


@given(SEED)
def test_dense_round_trip(seed: int) -> None:
    distance = np.random.default_rng(seed).integers(0, 65536, (3, 40))
    rows = encode_dense(np.array([100, 500, 900]), distance, NO_RESTART)
    assert np.array_equal(decode_dense(rows).distance_q2, distance[:2].reshape(-1) * 4)
    assert [start_q6(rows, place) for place in range(3)] == [100, 500, 900]


@given(arrays(np.int64, 3 * 96 + 1, elements=st.one_of(st.just(0), st.integers(1, 28656))))
def test_ultra_keeps_distances_to_the_scale_or_drops_them(distance: np.ndarray) -> None:
    samples = decode_ultra(encode_ultra(np.array([0, 2304, 4608]), distance, NO_RESTART))
    decoded, sent = samples.distance_q2 // 4, distance[:192]
    kept = decoded > 0
    assert not decoded[sent == 0].any()
    major = np.arange(192) % 3 == 0
    assert np.array_equal(kept[major], sent[major] > 0)
    # The step of each sample: its own scale for a major, the coarser of its two neighbours' for a prediction.
    scale = VBS_SHIFT[vbs_code(distance[::3])]
    coarsest = np.maximum(np.repeat(scale[:-1], 3), np.repeat(scale[1:], 3))[:192]
    step = 1 << np.where(major, np.repeat(scale[:-1], 3)[:192], coarsest)
    assert (np.abs(decoded - sent)[kept] < step[kept]).all()


@given(st.integers(600, 28000), SEED)
def test_ultra_loses_nothing_on_a_smooth_wall(distance_mm: int, seed: int) -> None:
    jumps = np.random.default_rng(seed).integers(-MAX_PREDICTION // 2, MAX_PREDICTION // 2, 193)
    distance = np.clip(distance_mm + jumps, 1, 28656)
    samples = decode_ultra(encode_ultra(np.array([0, 2304]), distance[:193].repeat(1), NO_RESTART[:2])[:2])
    assert (samples.distance_q2 > 0).all()
    assert np.abs(samples.distance_q2 // 4 - distance[:96]).max() < 16
    assert ultra_offset_q16(samples.distance_q2).min() > 0
