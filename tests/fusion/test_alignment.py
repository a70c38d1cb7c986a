"""An alignment seen from the other map."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment, Alternative, inverse_jacobian
from mapping import se2

POSE = np.array([3.0, -7.0, 2.1])
COVARIANCE = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.001], [0.002, -0.001, 0.0004]])


@pytest.mark.parametrize("pose", [POSE, np.array([0.0, 2.0, -3.0]), np.zeros(3)])
def test_the_jacobian_is_the_derivative_of_the_inverse(pose):
    step = 1e-6
    differences = [
        (se2.inverse(pose + step * axis) - se2.inverse(pose - step * axis)) / (2 * step) for axis in np.eye(3)
    ]
    np.testing.assert_allclose(inverse_jacobian(pose), np.column_stack(differences), atol=1e-8)


def test_a_cloud_of_poses_has_the_covariance_that_the_inverse_says():
    random = np.random.default_rng(1)
    cloud = random.multivariate_normal(POSE, COVARIANCE / 1e4, 20000)  # small: the inverse is not linear
    found = Alignment(POSE, True, "", covariance=COVARIANCE / 1e4).inverse()
    sampled = np.cov(np.array([se2.inverse(pose) for pose in cloud]).T)
    assert found.covariance is not None
    np.testing.assert_allclose(found.covariance, sampled, atol=0.05 * np.abs(sampled).max())


def test_the_inverse_of_the_inverse_is_the_alignment():
    there = Alignment(POSE, True, "why", 12, 0.9, 0.4, 0.8, COVARIANCE, (Alternative(np.array([1.0, 2.0, 0.5]), 0.1),))
    back = there.inverse().inverse()
    assert back.T_a_b is not None
    assert back.covariance is not None
    np.testing.assert_allclose(back.T_a_b, POSE, atol=1e-12)
    np.testing.assert_allclose(back.covariance, COVARIANCE, atol=1e-12)
    np.testing.assert_allclose(back.alternatives[0].T_a_b, [1.0, 2.0, 0.5], atol=1e-12)
    kept = ("accepted", "reason", "inliers", "acceptance", "overlap", "probability")
    assert [getattr(back, name) for name in kept] == [getattr(there, name) for name in kept]


def test_without_a_pose_the_verdict_stays():
    refused = Alignment(None, False, "no free cell").inverse()
    assert (refused.T_a_b, refused.covariance, refused.reason) == (None, None, "no free cell")
