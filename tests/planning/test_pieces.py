"""Chains of pieces: what they cost and where they lead."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from planning.edges import REEDS_SHEPP
from planning.pieces import Pieces, words_between

POSES = np.array([[1.0, 1.0, 0.0], [2.0, 1.5, 1.0], [1.0, 2.0, 3.0], [0.5, 1.0, -2.0]])
WORDS = (REEDS_SHEPP, 0.5, 1.5, 0.3)


def test_words_lead_through_the_poses_and_no_step_is_longer_than_a_centimetre():
    chain = words_between(POSES, *WORDS)
    poses, gears = chain.sampled(0.5)
    np.testing.assert_array_equal(poses[0], POSES[0])
    np.testing.assert_allclose(poses[-1], POSES[-1], atol=1e-9)
    for pose in POSES:
        assert np.hypot(*(poses[:, :2] - pose[:2]).T).min() < 1e-9
    steps = np.diff(poses, axis=0)
    lengths_m, turns = np.hypot(steps[:, 0], steps[:, 1]), se2.wrap_angle(steps[:, 2])
    assert lengths_m.max() <= 0.01 + 1e-9
    assert (np.abs(turns) <= lengths_m / 0.5 * 1.001 + 1e-9).all()
    middle = poses[:-1, 2] + turns / 2.0
    assert ((steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)) * gears[:-1] > 0.0).all()


def test_the_cost_of_a_chain_is_that_of_its_parts_and_of_the_cusps_between():
    first, second = words_between(POSES[:2], *WORDS), words_between(POSES[1:], *WORDS)
    whole = first.followed_by(second)
    assert whole.length_m == pytest.approx(first.length_m + second.length_m)
    joint = 0.3 * ((first.lengths[-1] > 0.0) != (second.lengths[0] > 0.0))
    parts = first.cost_m(1.5, 0.3) + second.cost_m(1.5, 0.3)
    assert whole.cost_m(1.5, 0.3) == pytest.approx(parts + joint)
    assert whole.cost_m(1.0, 0.0) == pytest.approx(whole.length_m)


def test_a_metre_backwards_and_a_cusp_have_their_price():
    starts, turns = np.zeros((3, 3)), np.zeros(2, np.int64)
    there_and_back = Pieces(starts, np.array([1.0, -2.0]), turns)
    assert there_and_back.cost_m(1.5, 0.3) == pytest.approx(1.0 + 0.3 + 2.0 * 1.5)


def test_a_place_alone_is_a_path_of_one_pose():
    poses, gears = words_between(POSES[:1], *WORDS).sampled(0.5)
    np.testing.assert_array_equal(poses, POSES[:1])
    assert gears.tolist() == [1]
