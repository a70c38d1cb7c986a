from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping import se2
from mapping.scan_refinement import partners_of, refine_scan
from mapping.surface import surface_of

KEYFRAMES = np.column_stack([np.linspace(2.0, 5.0, 10), np.linspace(1.5, 3.0, 10), np.linspace(0.0, 2.0, 10)])


@pytest.fixture(scope="module")
def place(room, site):
    return site(room)


@pytest.fixture(scope="module")
def clouds(place):
    return place.keyframes(KEYFRAMES).snapshot()


def test_a_scan_finds_its_place_between_keyframes(place, clouds) -> None:
    truth = np.array([3.5, 2.2, 1.1])
    surface = surface_of(place.look(truth, 77), np.zeros(2))
    for seed in range(8):
        guess = truth + np.random.default_rng(seed).uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.02]
        partners = partners_of(guess, 4, KEYFRAMES)
        refined = refine_scan(clouds, surface, guess, partners, KEYFRAMES[partners])
        off = se2.between(truth, refined)
        assert np.hypot(off[0], off[1]) < 0.015
        assert abs(off[2]) < np.radians(0.3)


def test_a_scan_that_sees_no_wall_stays(place, clouds) -> None:
    guess = np.array([3.5, 2.2, 1.1])
    partners = partners_of(guess, 4, KEYFRAMES)
    nothing = surface_of(np.zeros((0, 2)), np.zeros(2))
    np.testing.assert_array_equal(refine_scan(clouds, nothing, guess, partners, KEYFRAMES[partners]), guess)
    elsewhere = surface_of(np.add(place.look(guess), [100.0, 0.0]), np.zeros(2))
    np.testing.assert_array_equal(refine_scan(clouds, elsewhere, guess, partners, KEYFRAMES[partners]), guess)


@given(st.integers(1, 40), st.integers(0, 39), st.integers(0, 2**32 - 1))
def test_partners_are_its_keyframes_and_the_nearest_others(count: int, keyframe: int, seed: int) -> None:
    keyframe %= count
    generator = np.random.default_rng(seed)
    poses, pose = generator.uniform(-5.0, 5.0, (count, 3)), generator.uniform(-5.0, 5.0, 3)
    partners = partners_of(pose, keyframe, poses).tolist()
    assert len(set(partners)) == len(partners) == min(6, count)
    own = [number for number in (keyframe, keyframe + 1) if number < count]
    assert partners[: len(own)] == own
    distance = np.hypot(*(poses[:, :2] - pose[:2]).T)
    others = [number for number in np.argsort(distance).tolist() if number not in own]
    assert partners[len(own) :] == others[: len(partners) - len(own)]
