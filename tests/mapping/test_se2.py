from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]

# 100 m is farther than a car drives in one building; float64 then resolves 1e-14 m, a few operations lose two digits.
LENGTHS_M = st.floats(-100.0, 100.0)
POSES = st.tuples(LENGTHS_M, LENGTHS_M, st.floats(-10.0, 10.0)).map(np.array)
POINTS = st.lists(st.tuples(LENGTHS_M, LENGTHS_M), min_size=1, max_size=5).map(np.array)
CLOSE = 1e-11


def assert_same_pose(actual: FloatArray, expected: FloatArray, tolerance: float = CLOSE) -> None:
    np.testing.assert_allclose(actual[..., :2], expected[..., :2], rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(se2.wrap_angle(actual[..., 2] - expected[..., 2]), 0.0, atol=tolerance)


@given(POSES)
def test_inverse_undoes_a_pose(pose: FloatArray) -> None:
    assert_same_pose(se2.compose(pose, se2.inverse(pose)), se2.IDENTITY)
    assert_same_pose(se2.compose(se2.inverse(pose), pose), se2.IDENTITY)
    assert_same_pose(se2.inverse(se2.inverse(pose)), pose)


@given(POSES, POSES, POSES)
def test_composition_is_associative(a: FloatArray, b: FloatArray, c: FloatArray) -> None:
    assert_same_pose(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@given(POSES, POSES)
def test_composition_is_the_matrix_product(a: FloatArray, b: FloatArray) -> None:
    np.testing.assert_allclose(
        se2.to_matrix4(se2.compose(a, b)), se2.to_matrix4(a) @ se2.to_matrix4(b), rtol=0.0, atol=CLOSE
    )


@given(POSES, POSES)
def test_between_leads_from_one_pose_to_the_other(a: FloatArray, b: FloatArray) -> None:
    assert_same_pose(se2.compose(a, se2.between(a, b)), b)


@given(POSES, POSES)
def test_one_pose_and_many_give_the_same_bits(a: FloatArray, b: FloatArray) -> None:
    many_a, many_b = np.tile(a, (3, 1)), np.tile(b, (3, 1))
    assert np.array_equal(se2.compose(many_a, many_b)[1], se2.compose(a, b))
    assert np.array_equal(se2.inverse(many_a)[1], se2.inverse(a))
    assert np.array_equal(se2.between(many_a, many_b)[1], se2.between(a, b))


@given(POSES)
def test_matrix_round_trip(pose: FloatArray) -> None:
    assert_same_pose(se2.from_matrix4(se2.to_matrix4(pose)), pose)


@given(POSES, POINTS)
def test_points_move_as_the_matrix_moves_them(pose: FloatArray, points: FloatArray) -> None:
    homogeneous = np.column_stack([points, np.zeros(len(points)), np.ones(len(points))])
    expected = (se2.to_matrix4(pose) @ homogeneous.T).T[:, :2]
    np.testing.assert_allclose(se2.transform_points(pose, points), expected, rtol=0.0, atol=CLOSE)


@given(POSES, POSES, POINTS)
def test_moving_points_twice_is_moving_them_by_the_composition(
    a: FloatArray, b: FloatArray, points: FloatArray
) -> None:
    twice = se2.transform_points(a, se2.transform_points(b, points))
    np.testing.assert_allclose(twice, se2.transform_points(se2.compose(a, b), points), rtol=0.0, atol=CLOSE)


# At half a turn log's cotangent makes the answer sensitive; no robot turns 3 rad between two scans.
@given(st.tuples(LENGTHS_M, LENGTHS_M, st.floats(-3.0, 3.0)).map(np.array))
def test_log_undoes_exp(twist: FloatArray) -> None:
    assert_same_pose(se2.log(se2.exp(twist)), twist, tolerance=1e-10)


@given(st.tuples(LENGTHS_M, LENGTHS_M, st.floats(-3.1, 3.1)).map(np.array))
def test_exp_undoes_log(pose: FloatArray) -> None:
    assert_same_pose(se2.exp(se2.log(pose)), pose, tolerance=1e-10)


@given(
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)).map(np.array),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_time_at_a_constant_twist_adds_up(twist: FloatArray, first: float, second: float) -> None:
    assert_same_pose(
        se2.compose(se2.exp(twist * first), se2.exp(twist * second)), se2.exp(twist * (first + second)), tolerance=1e-12
    )


@pytest.mark.parametrize(
    ("twist", "pose"),
    [
        ((2.0, 0.0, 0.0), (2.0, 0.0, 0.0)),
        ((np.pi / 2, 0.0, np.pi / 2), (1.0, 1.0, np.pi / 2)),  # a quarter of a circle of radius 1, to the left
        ((np.pi / 2, 0.0, -np.pi / 2), (1.0, -1.0, -np.pi / 2)),
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_exp_of_known_motions(twist: tuple[float, float, float], pose: tuple[float, float, float]) -> None:
    assert_same_pose(se2.exp(twist), np.array(pose))


@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 1e-9, 2e-9, 1e-8, 1e-7, 1e-5, -1e-8])
def test_exp_of_the_slightest_turn_drifts_sideways_by_half_of_it(turn_rad: float) -> None:
    # Series y = vx * (w / 2 - w^3 / 24): 1 - cos(w) would lose all digits here.
    pose = se2.exp([1.0, 0.0, turn_rad])
    np.testing.assert_allclose(pose[:2], [1.0 - turn_rad**2 / 6.0, turn_rad / 2.0], rtol=1e-9, atol=0.0)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angle_is_the_same_direction_in_range(angle_rad: float) -> None:
    wrapped = float(se2.wrap_angle(angle_rad))
    assert -np.pi <= wrapped < np.pi
    np.testing.assert_allclose([np.cos(wrapped), np.sin(wrapped)], [np.cos(angle_rad), np.sin(angle_rad)], atol=1e-12)


def test_half_a_turn_wraps_to_minus_pi() -> None:
    assert se2.wrap_angle(np.pi) == -np.pi
    assert se2.wrap_angle(-np.pi) == -np.pi


def test_functions_broadcast_over_many_poses() -> None:
    one, many = np.array([1.0, 2.0, 0.3]), np.arange(12.0).reshape(4, 3) / 10.0
    together = se2.compose(one, many)
    assert together.shape == (4, 3)
    for index in range(4):
        assert_same_pose(together[index], se2.compose(one, many[index]))
        assert_same_pose(se2.exp(many)[index], se2.exp(many[index]))
        assert_same_pose(se2.log(many)[index], se2.log(many[index]))
    points = np.arange(8.0).reshape(4, 2)
    moved = se2.transform_points(many, points)
    np.testing.assert_allclose(moved[2], se2.transform_points(many[2], points[2:3])[0])


def test_identity_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        se2.IDENTITY[0] = 1.0
