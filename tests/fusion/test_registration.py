"""The choice of the method, and what every method shares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.algorithm3 import THESIS, FloatArray, register_by_features
from fusion.alignment import Alignment
from fusion.registration import register
from mapping import se2
from mapping.grid import OccupancyGrid

FRAME = np.array([3.0, -7.0, 2.1])


def pose_of(found: Alignment) -> FloatArray:
    """The pose of an alignment that must have one."""
    assert found.T_a_b is not None, found.reason
    return found.T_a_b


@pytest.mark.parametrize("method", ["default", "thesis"])
def test_the_same_map_saved_with_another_origin_is_placed_exactly(view, method):
    a = view(0.0, 20.0, np.zeros(3), 1)
    moved = OccupancyGrid(a.log_odds, a.resolution_m, se2.compose(FRAME, a.origin))
    np.testing.assert_allclose(pose_of(register(a, moved, method)), se2.inverse(FRAME), atol=1e-9)


@pytest.mark.parametrize("method", ["default", "thesis"])
def test_exchanging_the_maps_gives_the_inverse(view, method):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(6.0, 30.0, FRAME, 2)
    there, back = register(a, b, method), register(b, a, method)
    np.testing.assert_allclose(se2.compose(pose_of(there), pose_of(back)), np.zeros(3), atol=1e-12)


def test_the_method_of_the_thesis_is_algorithm_3_with_the_settings_given(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(6.0, 30.0, FRAME, 2)
    settings = replace(THESIS, alpha=0.7)
    found, expected = register(a, b, "thesis", 3, settings), register_by_features(a, b, settings, 3)
    assert pose_of(found).tolist() == pose_of(expected).tolist()
    assert found.reason == expected.reason
