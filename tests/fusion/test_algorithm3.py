"""The whole of Algorithm 3 on views of a drawn floor."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.algorithm3 import THESIS, TOLERANT, FloatArray, register_by_features
from fusion.alignment import Alignment
from fusion.evaluation import alignment_error
from mapping import se2
from mapping.grid import OccupancyGrid

FRAMES = [np.array([3.0, -7.0, 2.1]), np.array([-15.0, 4.0, -0.7]), np.array([0.0, 12.0, np.pi / 2])]


def pose_of(found: Alignment) -> FloatArray:
    """The pose of an alignment that must have one."""
    assert found.T_a_b is not None, found.reason
    return found.T_a_b


def grid_of(values: list[list[float]]) -> OccupancyGrid:
    return OccupancyGrid(np.array(values, dtype=np.float32), 0.05, np.zeros(3))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("resolution_a", "resolution_b"), [(0.05, 0.05), (0.04, 0.08)])
def test_finds_the_pose_of_overlapping_views(view, frame, resolution_a, resolution_b):
    a = view(0.0, 20.0, np.array([1.0, 2.0, 0.3]), 1, resolution_a)
    b = view(9.0, 30.0, frame, 2, resolution_b)
    truth = se2.compose(np.array([1.0, 2.0, 0.3]), se2.inverse(frame))
    found = register_by_features(a, b, TOLERANT)
    assert found.accepted, found.reason
    error = alignment_error(a, b, pose_of(found), truth)
    assert error.rms_m < 0.10
    assert error.rotation_deg < 1.0


def test_exchanging_the_maps_gives_the_inverse_to_the_last_digit(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, FRAMES[0], 2)
    there, back = register_by_features(a, b, TOLERANT), register_by_features(b, a, TOLERANT)
    assert there.accepted
    np.testing.assert_allclose(se2.compose(pose_of(there), pose_of(back)), np.zeros(3), atol=1e-12)
    assert (there.inliers, there.acceptance) == (back.inliers, back.acceptance)


def test_same_seed_same_answer(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, FRAMES[1], 2)
    assert (
        pose_of(register_by_features(a, b, TOLERANT, 5)).tolist()
        == pose_of(register_by_features(a, b, TOLERANT, 5)).tolist()
    )


@pytest.mark.parametrize("settings", [THESIS, TOLERANT])
def test_views_that_share_nothing_are_refused(view, settings):
    a, b = view(0.0, 13.0, np.zeros(3), 1), view(17.0, 30.0, FRAMES[0], 2)
    assert not register_by_features(a, b, settings).accepted


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([[0.0, 0.0], [0.0, 0.0]], "no cell that is free"),
        ([[2.0, 2.0], [2.0, 2.0]], "no cell that is free"),
        ([[-2.0]], "no motion fits"),
    ],
)
@pytest.mark.parametrize("swap", [False, True])
def test_maps_that_cannot_be_aligned_are_refused_with_the_reason(view, values, reason, swap):
    poor, rich = grid_of(values), view(0.0, 20.0, np.zeros(3), 1)
    found = register_by_features(rich, poor, TOLERANT) if swap else register_by_features(poor, rich, TOLERANT)
    assert not found.accepted
    assert reason in found.reason
    if "free" in reason:
        assert ("second" if swap else "first") in found.reason


def test_one_cell_maps_are_not_taken_for_one_map():
    assert not register_by_features(grid_of([[-2.0]]), grid_of([[-2.0]]), THESIS).accepted


def test_the_thesis_settings_are_the_thesis_values():
    assert (THESIS.alpha, THESIS.max_ratio, THESIS.tolerance_px, THESIS.trials) == (0.99, 0.6, 1.5, 1000)
    assert (THESIS.confidence, THESIS.rule.min_inliers, THESIS.rule.min_acceptance) == (0.99, 10, 0.95)
