"""MSAC on matches with known outliers."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.consensus import find_consensus
from mapping import se2

TRUTH = np.array([4.0, -2.0, 2.5])


@pytest.mark.parametrize("outliers", [0, 60, 150])
def test_finds_the_motion_among_outliers(outliers):
    random = np.random.default_rng(outliers)
    b = random.uniform(-10, 10, (50 + outliers, 2))
    a = se2.transform_points(TRUTH, b) + random.normal(0, 0.02, b.shape)
    a[50:] = random.uniform(-10, 10, (outliers, 2))
    found = find_consensus(a, b, 0.15, trials=5000, confidence=0.99, seed=1)
    assert found is not None
    np.testing.assert_allclose(found.T_a_b, TRUTH, atol=0.02)
    assert found.inliers[:50].all()
    assert found.inliers[50:].mean() < 0.1 if outliers else True


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_matches_have_no_motion(count):
    points = np.zeros((count, 2))
    assert find_consensus(points, points, 0.1, trials=100, confidence=0.99, seed=0) is None


def test_points_in_one_place_have_no_motion():
    points = np.ones((8, 2))
    assert find_consensus(points, points, 0.1, trials=100, confidence=0.99, seed=0) is None


@pytest.mark.parametrize("scale", [0.4, 1.0, 2.5])
@pytest.mark.parametrize("outliers", [0, 60])
def test_a_similarity_has_the_scale_too(scale, outliers):
    random = np.random.default_rng(outliers)
    b = random.uniform(-10, 10, (50 + outliers, 2))
    a = se2.transform_points(TRUTH, scale * b) + random.normal(0, 0.02, b.shape)
    a[50:] = random.uniform(-10, 10, (outliers, 2))
    found = find_consensus(a, b, 0.15, trials=5000, confidence=0.99, seed=1, free_scale=True)
    assert found is not None
    assert found.scale == pytest.approx(scale, abs=0.002)
    np.testing.assert_allclose(found.T_a_b, TRUTH, atol=0.02)
    assert found.inliers[:50].all()


def test_a_rigid_motion_has_no_scale():
    b = np.random.default_rng(3).uniform(-10, 10, (40, 2))
    found = find_consensus(se2.transform_points(TRUTH, 1.3 * b), b, 0.1, trials=500, confidence=0.99, seed=0)
    assert found is None or (found.scale == 1.0 and found.inliers.sum() < 20)


def test_a_map_is_not_shrunk_to_a_point_to_fit():
    """All of b's points match within the tolerance of one place in a, if the scale may be next to nothing."""
    random = np.random.default_rng(4)
    a, b = random.uniform(0, 0.3, (30, 2)), random.uniform(-10, 10, (30, 2))
    found = find_consensus(a, b, 0.2, trials=500, confidence=0.99, seed=0, free_scale=True)
    assert found is None or found.inliers.sum() < 15
