from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.messages import Odometry
from mapping import se2
from mapping.wheel_odometry import WheelOdometry

FloatArray = NDArray[np.float64]

SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS


def driven(
    twist: FloatArray, start: FloatArray | None = None, *, seconds: float = 2.0, rate_hz: int = 20
) -> WheelOdometry:
    """Return the odometry of a constant twist from a start pose, one message every 1 / rate_hz."""
    wheels = WheelOdometry()
    for index in range(int(seconds * rate_hz) + 1):
        pose = se2.compose(np.zeros(3) if start is None else start, se2.exp(twist * (index / rate_hz)))
        wheels.add(Odometry(START_NS + index * SECOND_NS // rate_hz, pose, twist))
    return wheels


@given(
    st.tuples(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5), st.floats(-3.0, 3.0)).map(np.array),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.1, 3.1)).map(np.array),
    st.integers(0, 2 * SECOND_NS),
    st.integers(0, 2 * SECOND_NS),
)
def test_constant_motion_is_exact_between_messages_too(
    twist: FloatArray, start: FloatArray, first_ns: int, second_ns: int
) -> None:
    begin_ns, end_ns = sorted((first_ns, second_ns))
    motion = driven(twist, start).motion(START_NS + begin_ns, START_NS + end_ns)
    expected = se2.exp(twist * ((end_ns - begin_ns) * 1e-9))
    difference = se2.between(expected, motion)
    # Interpolation on the circle is exact; coordinates of 50 m leave 1e-14, the logarithm of a pose two digits less.
    np.testing.assert_allclose(difference, 0.0, atol=1e-11)


def test_motion_is_seen_from_the_body_at_the_start() -> None:
    wheels = WheelOdometry()
    wheels.add(Odometry(0, np.array([5.0, 5.0, np.pi / 2]), np.zeros(3)))
    wheels.add(Odometry(10, np.array([5.0, 6.0, np.pi / 2]), np.zeros(3)))
    np.testing.assert_allclose(wheels.motion(0, 10), [1.0, 0.0, 0.0], atol=1e-12)


def test_only_what_messages_enclose_is_covered() -> None:
    wheels = WheelOdometry()
    assert wheels.latest_ns is None
    assert not wheels.covers(0, 0)
    for stamp_ns in (100, 200):
        wheels.add(Odometry(stamp_ns, np.zeros(3), np.zeros(3)))
    assert wheels.latest_ns == 200
    assert wheels.covers(100, 200)
    assert not wheels.covers(99, 150)
    assert not wheels.covers(150, 201)


@pytest.mark.parametrize("stamp_ns", [50, 200])
def test_messages_that_step_back_or_repeat_are_ignored(stamp_ns: int) -> None:
    wheels = WheelOdometry()
    wheels.add(Odometry(100, np.zeros(3), np.zeros(3)))
    wheels.add(Odometry(200, np.array([1.0, 0.0, 0.0]), np.zeros(3)))
    wheels.add(Odometry(stamp_ns, np.array([9.0, 9.0, 0.0]), np.zeros(3)))
    assert wheels.latest_ns == 200
    np.testing.assert_allclose(wheels.motion(100, 200), [1.0, 0.0, 0.0])


def test_old_messages_are_forgotten() -> None:
    wheels = WheelOdometry(keep_s=1.0)
    for second in range(5):
        wheels.add(Odometry(second * SECOND_NS, np.array([float(second), 0.0, 0.0]), np.zeros(3)))
    assert not wheels.covers(2 * SECOND_NS, 4 * SECOND_NS)
    np.testing.assert_allclose(wheels.motion(3 * SECOND_NS, 4 * SECOND_NS), [1.0, 0.0, 0.0])
