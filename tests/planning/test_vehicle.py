"""Outlines of cars: hulls, margins and radii."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planning.errors import PlanningError
from planning.vehicle import BETWEEN_POSES_M, Vehicle

SHIP = ((-0.1, -0.1), (0.2, -0.1), (0.35, 0.0), (0.2, 0.1), (-0.1, 0.1))


def test_the_default_is_a_qcar():
    car = Vehicle()
    assert np.ptp(car.body, axis=0).tolist() == pytest.approx([0.425, 0.192])
    assert car.body.mean(axis=0).tolist() == pytest.approx([0.128, 0.0])
    assert np.ptp(car.corners, axis=0).tolist() == pytest.approx([0.445, 0.212])
    assert car.inradius_m == pytest.approx(0.0945)
    assert car.outer_radius_m == pytest.approx(math.hypot(0.3505, 0.106))
    assert car.area_m2 == pytest.approx(0.425 * 0.192)


@pytest.mark.parametrize("order", [SHIP, SHIP[::-1], (*SHIP, (0.0, 0.0), (0.05, -0.1)), (*SHIP[2:], *SHIP[:2])])
def test_order_inner_points_and_points_on_sides_do_not_matter(order):
    assert Vehicle(order).footprint == Vehicle(SHIP).footprint
    assert Vehicle(order).area_m2 == pytest.approx(0.3 * 0.2 + 0.15 * 0.2 / 2)


@given(arrays(np.float64, st.tuples(st.integers(3, 9), st.just(2)), elements=st.floats(-1.0, 1.0)), st.floats(0.0, 0.2))
def test_the_margin_lies_outside_every_side_and_no_more(points, margin_m):
    try:
        car = Vehicle(tuple(map(tuple, points.tolist())), margin_m=margin_m)
    except PlanningError:
        return
    sides = np.roll(car.body, -1, axis=0) - car.body
    normals = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.hypot(*sides.T)[:, np.newaxis]
    offsets = (normals * car.body).sum(axis=1)
    # Each grown side is the old one moved by the margin: both of its ends lie on that line, all other corners inside.
    beyond = car.corners @ normals.T - offsets - margin_m - BETWEEN_POSES_M
    assert beyond.max() < 1e-6
    np.testing.assert_allclose(np.diag(beyond), 0.0, atol=1e-6)
    assert offsets.min() + margin_m + BETWEEN_POSES_M == pytest.approx(car.inradius_m, abs=1e-9)
    assert (points @ normals.T <= offsets + 1e-6).all()


def test_a_car_survives_a_pickle():
    car = Vehicle(SHIP, reverse_cost=2.0)
    copy = pickle.loads(pickle.dumps(car))  # noqa: S301 - its own bytes
    assert copy == car
    assert hash(copy) == hash(car)
    np.testing.assert_array_equal(copy.corners, car.corners)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"turning_radius_m": 0.0}, "turning_radius_m is 0"),
        ({"turning_radius_m": 0.1}, "0.2 or more"),
        ({"turning_radius_m": math.inf}, "turning_radius_m is inf"),
        ({"margin_m": -0.1}, "margin_m is -0.1"),
        ({"reverse_cost": 0.9}, "reverse_cost is 0.9, expected 1 or more"),
        ({"cusp_cost_m": math.nan}, "cusp_cost_m is nan"),
        ({"footprint": ((0.0, 0.0), (1.0, math.nan), (0.0, 1.0))}, "not finite"),
        ({"footprint": ((-1.0, 0.0), (0.0, 0.0), (1.0, 0.0))}, "encloses no area"),
        ({"footprint": ()}, "encloses no area"),
        ({"footprint": ((1.0, 2.0, 3.0),)}, "expected corners"),
        ({"footprint": ((0.1, -0.1), (0.4, -0.1), (0.4, 0.1), (0.1, 0.1))}, "not inside the footprint"),
    ],
)
def test_what_makes_no_car_is_refused(values, words):
    with pytest.raises(PlanningError, match=words):
        Vehicle(**values)
