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
