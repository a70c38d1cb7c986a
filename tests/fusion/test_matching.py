"""The ratio test: MATLAB's ratio of squared distances against the one of distances that everybody else uses."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.matching import match_descriptors


def descriptors(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 255.0, (count, 128)).astype(np.float32)


@pytest.mark.parametrize(("ssd_ratio", "distance_ratio"), [(0.6, 0.6**0.5), (0.8, 0.8**0.5)])
def test_a_ratio_of_squares_is_the_square_of_the_ratio_of_distances(ssd_ratio, distance_ratio):
    random = np.random.default_rng(1)
    a = descriptors(300, 2)
    b = (a[:200] + random.normal(0.0, random.uniform(0.0, 160.0, (200, 1)), (200, 128))).astype(np.float32)
    distances = np.linalg.norm(b[:, np.newaxis].astype(np.float64) - a, axis=2)
    nearest = np.sort(distances, axis=1)
    kept = nearest[:, 0] < distance_ratio * nearest[:, 1]
    assert 20 < np.count_nonzero(kept) < 180  # the noise is such that the test decides
    in_a, in_b = match_descriptors(a, b, ssd_ratio)
    chosen = distances.argmin(axis=1)
    assert len(set(chosen[kept])) == np.count_nonzero(kept)  # no place in a is wanted twice here
    assert set(zip(in_a.tolist(), in_b.tolist(), strict=True)) == set(
        zip(chosen[kept].tolist(), np.flatnonzero(kept).tolist(), strict=True)
    )


def test_a_descriptor_wanted_twice_goes_to_the_nearest():
    a = descriptors(20, 3)
    b = np.vstack([a[4] + 3.0, a[4] + 1.0, a[4] + 2.0]).astype(np.float32)
    in_a, in_b = match_descriptors(a, b, 0.6)
    assert (in_a.tolist(), in_b.tolist()) == ([4], [1])


@pytest.mark.parametrize(("count_a", "count_b"), [(0, 5), (1, 5), (5, 0)])
def test_without_a_second_nearest_nothing_matches(count_a, count_b):
    in_a, in_b = match_descriptors(descriptors(count_a, 4), descriptors(count_b, 5), 0.8)
    assert len(in_a) == len(in_b) == 0


def test_the_hamming_distance_of_bits_is_their_sum_of_squared_differences():
    random = np.random.default_rng(6)
    a = random.integers(0, 256, (200, 32), np.uint8)
    flips = np.packbits(random.random((150, 256)) < random.uniform(0.0, 0.5, (150, 1)), axis=1)
    b = a[:150] ^ flips
    number_a, number_b = (np.unpackbits(each, axis=1).astype(np.float32) for each in (a, b))
    by_bits, by_numbers = match_descriptors(a, b, 0.6), match_descriptors(number_a, number_b, 0.6)
    assert 20 < len(by_bits[0]) < 140
    assert [each.tolist() for each in by_bits] == [each.tolist() for each in by_numbers]
