"""The error of an alignment, as the design defines it."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import FusionError
from fusion.evaluation import POINTS, alignment_error, common_free_points, free_points
from mapping import se2
from mapping.grid import OccupancyGrid

TRUTH = np.array([30.0, -20.0, 1.0])  # far from the origin, where a turn moves everything


def views(view):
    return view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, se2.inverse(TRUTH), 2)


def test_the_truth_has_no_error(view):
    a, b = views(view)
    error = alignment_error(a, b, TRUTH, TRUTH)
    assert (error.rms_m, error.rotation_deg) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_shift_is_its_length_and_a_turn_is_felt_where_the_maps_overlap(view):
    a, b = views(view)
    shifted = alignment_error(a, b, TRUTH + np.array([0.3, 0.4, 0.0]), TRUTH)
    assert (shifted.rms_m, shifted.rotation_deg) == pytest.approx((0.5, 0.0), abs=1e-9)
    center = common_free_points(a, b, TRUTH).mean(axis=0)
    about_center = se2.compose(np.array([*center, np.radians(2.0)]), np.array([*-center, 0.0]))
    turned = alignment_error(a, b, se2.compose(TRUTH, about_center), TRUTH)
    assert turned.rotation_deg == pytest.approx(2.0)
    assert 0.1 < turned.rms_m < 0.4  # 2 deg over some metres; at the frame's origin it would be over a metre


def test_the_points_are_spread_over_the_common_free_space(view):
    a, b = views(view)
    points = common_free_points(a, b, TRUTH)
    assert len(points) == POINTS
    in_a = se2.transform_points(TRUTH, points)
    assert (in_a[:, 0] > 8.9).all()
    assert (in_a[:, 0] < 20.1).all()
    assert np.ptp(in_a[:, 0]) > 10.0
    assert np.ptp(in_a[:, 1]) > 16.0


def test_maps_without_common_free_space_have_no_error(view):
    a, _ = views(view)
    with pytest.raises(FusionError, match="share no free space"):
        alignment_error(a, OccupancyGrid(np.full((3, 3), 2.0, np.float32), 0.05, np.zeros(3)), TRUTH, TRUTH)


def test_points_of_one_map_are_spread_over_its_free_space(view):
    grid = view(0.0, 12.0, np.array([3.0, 1.0, 0.5]), 1)
    points = free_points(grid)
    assert points.shape == (POINTS, 2)
    col, row = np.floor(grid.cell_coordinates(points)).astype(int).T
    assert grid.free[row, col].all()
    assert np.ptp(points, axis=0).min() > 10.0
    walls_only = OccupancyGrid(np.full((3, 3), 2.0, np.float32), 0.05, np.zeros(3))
    assert free_points(walls_only).shape == (0, 2)
