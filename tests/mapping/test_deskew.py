from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping import se2
from mapping.deskew import deskew, reference_offset_s
from mapping.mount import Mount

FloatArray = NDArray[np.float64]

OFFSETS_S = np.linspace(0.0, 0.1, 50)
SPEEDS = st.tuples(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0)).map(np.array)
MOUNTS = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.1, 3.1)).map(np.array)


def sample(points_world: FloatArray, body: FloatArray, mount: Mount) -> tuple[FloatArray, FloatArray]:
    """Return angles and ranges (N,) of points (N, 2) as the laser sees each from the body pose (N, 3) of its time."""
    local = se2.transform_points(se2.inverse(se2.compose(body, mount.pose)), points_world)
    side = -1.0 if mount.inverted else 1.0
    return np.arctan2(side * local[:, 1], local[:, 0]), np.hypot(local[:, 0], local[:, 1])


@given(SPEEDS, MOUNTS, st.booleans())
def test_known_motion_is_undone_with_the_laser_off_the_axle(
    twist: FloatArray, pose: FloatArray, inverted: bool
) -> None:
    points = np.random.default_rng(5).uniform(-6.0, 6.0, (len(OFFSETS_S), 2))
    mount = Mount(pose, inverted=inverted)
    reference_s = reference_offset_s(OFFSETS_S)
    body = se2.exp(twist * (OFFSETS_S - reference_s)[:, np.newaxis])  # the body is at the origin at reference_s
    raw = mount.to_body(*sample(points, body, mount))
    # A handful of operations on coordinates of 10 m: 1e-12 leaves a hundredfold margin.
    np.testing.assert_allclose(deskew(raw, OFFSETS_S, reference_s, twist), points, rtol=0.0, atol=1e-12)


def test_one_radian_a_second_bends_a_wall_by_as_much_as_stated() -> None:
    twist = np.array([0.0, 0.0, 1.0])
    first_and_last = deskew(np.array([[2.0, 0.0], [2.0, 0.0]]), np.array([0.0, 0.1]), 0.05, twist)
    headings = np.degrees(np.arctan2(first_and_last[:, 1], first_and_last[:, 0]))
    assert headings[1] - headings[0] == pytest.approx(np.degrees(0.1))


def test_standing_robot_changes_nothing() -> None:
    points = np.random.default_rng(1).uniform(-6.0, 6.0, (len(OFFSETS_S), 2))
    np.testing.assert_array_equal(deskew(points, OFFSETS_S, 0.05, np.zeros(3)), points)


def test_sample_at_the_reference_instant_stays() -> None:
    point = np.array([[3.0, 4.0]])
    np.testing.assert_array_equal(deskew(point, np.array([0.05]), 0.05, np.array([1.0, 0.0, 2.0])), point)


def test_reference_is_the_middle_of_the_turn() -> None:
    assert reference_offset_s(np.array([0.02, 0.05, 0.10])) == pytest.approx(0.06)
    assert reference_offset_s(np.zeros(3)) == 0.0
    assert reference_offset_s(np.zeros(0)) == 0.0


def test_no_points_stay_no_points() -> None:
    assert deskew(np.zeros((0, 2)), np.zeros(0), 0.0, np.ones(3)).shape == (0, 2)
