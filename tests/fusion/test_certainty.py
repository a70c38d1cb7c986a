"""Bayes fusion with a given transform."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.certainty import fuse_log_odds, fuse_pair
from mapping import se2
from mapping.grid import LOG_ODDS_CLAMP, OccupancyGrid

POSE = np.array([2.0, -1.0, 0.8])


def probability(log_odds: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-log_odds.astype(np.float64)))


@given(st.floats(-3.4, 3.4), st.floats(-3.4, 3.4))
def test_the_sum_of_log_odds_is_equation_3_16(a, b):
    p, q = probability(np.array(a)), probability(np.array(b))
    expected = p * q / (p * q + (1 - p) * (1 - q))
    fused = fuse_log_odds(np.array([[a]], np.float32), np.array([[b]], np.float32))
    assert probability(fused)[0, 0] == pytest.approx(expected, abs=1e-6)


def test_unknown_changes_nothing_and_the_clamp_holds():
    a = np.array([[-3.0, 0.0, LOG_ODDS_CLAMP]], np.float32)
    np.testing.assert_array_equal(fuse_log_odds(a, np.zeros_like(a)), a)
    np.testing.assert_array_equal(fuse_log_odds(a, a), [[-6.0, 0.0, LOG_ODDS_CLAMP]])


def test_fusing_with_an_unknown_map_returns_the_map(view):
    a = view(0.0, 12.0, np.zeros(3), 1)
    unknown = OccupancyGrid(np.zeros((50, 40), np.float32), a.resolution_m, np.zeros(3))
    fused = fuse_pair(a, unknown, POSE)
    rows, cols = np.nonzero(a.known)
    found = fused.grid.cell_coordinates(se2.transform_points(fused.T_global_a, a.cell_centers(rows, cols))).astype(int)
    np.testing.assert_array_equal(fused.grid.log_odds[found[:, 1], found[:, 0]], a.log_odds[rows, cols])
    assert np.count_nonzero(fused.grid.known) == len(rows)


def test_the_order_of_the_maps_changes_nothing(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1, 0.05), view(8.0, 30.0, POSE, 2, 0.04)
    one, other = fuse_pair(a, b, se2.inverse(POSE)), fuse_pair(b, a, POSE)
    np.testing.assert_array_equal(one.grid.log_odds, other.grid.log_odds)
    np.testing.assert_array_equal(one.grid.origin, other.grid.origin)
    np.testing.assert_allclose(one.T_global_a, other.T_global_b, atol=1e-12)
    assert one.grid.resolution_m == 0.04


def test_a_map_fused_with_itself_counts_once(view):
    a = view(0.0, 16.0, np.zeros(3), 1)
    fused = fuse_pair(a, a, se2.IDENTITY)
    assert fused.counted_once
    np.testing.assert_array_equal(fused.grid.log_odds[fused.grid.known], a.log_odds[a.known])


def test_two_runs_over_one_place_count_twice(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(0.0, 16.0, np.zeros(3), 2)
    fused = fuse_pair(a, b, se2.IDENTITY)
    assert not fused.counted_once
    assert np.abs(fused.grid.log_odds).max() > np.abs(a.log_odds).max()
