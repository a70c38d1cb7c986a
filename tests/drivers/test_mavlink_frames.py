"""Axes: what stands left in one world stands left in the other, told by its other sign."""

import math

import numpy as np
import pytest

from drivers.mavlink_frames import (
    NOTHING_KNOWN_CM,
    flipped_pose,
    flipped_vector,
    obstacle_sectors_cm,
    quaternion_frd,
    yaw_from_frd,
)
from drivers.messages import LaserScan
from mapping.se2 import compose


def scan(angles_deg: list[float], ranges_m: list[float]) -> LaserScan:
    zeros = np.zeros(len(ranges_m))
    return LaserScan(0, np.radians(angles_deg), np.array(ranges_m), zeros, 0.15, 12.0)


def test_left_is_minus_y_and_counter_clockwise_is_minus_yaw() -> None:
    np.testing.assert_array_equal(flipped_pose(np.array([1.0, 2.0, 0.5])), [1.0, -2.0, -0.5])
    np.testing.assert_array_equal(flipped_vector(np.array([0.1, 0.2, -9.8])), [0.1, -0.2, 9.8])


def test_flipping_commutes_with_driving_on() -> None:
    pose, motion = np.array([1.0, 2.0, 0.5]), np.array([0.4, 0.3, -1.1])
    both = compose(flipped_pose(pose), flipped_pose(motion))
    np.testing.assert_allclose(both, flipped_pose(compose(pose, motion)), atol=1e-12)


@pytest.mark.parametrize("yaw_rad", [-3.0, -0.4, 0.0, 1.3, 3.1])
def test_quaternion_turns_ahead_to_where_the_car_looks(yaw_rad: float) -> None:
    w, _, _, z = quaternion_frd(yaw_rad)
    assert yaw_from_frd(quaternion_frd(yaw_rad)) == pytest.approx(yaw_rad)
    # Rotating (1, 0) by the quaternion in FRD, y to the right: left of the map is negative.
    assert (w * w - z * z, 2 * w * z) == pytest.approx((math.cos(yaw_rad), -math.sin(yaw_rad)))


def test_sectors_count_clockwise_from_ahead() -> None:
    sectors = obstacle_sectors_cm(scan([0, 90, -90, 180, 30], [1.0, 2.0, 3.0, 4.0, 5.0]), np.zeros(3))
    known = {sector: value for sector, value in enumerate(sectors) if value != NOTHING_KNOWN_CM}
    assert known == {0: 100, 54: 200, 18: 300, 36: 400, 66: 500}


def test_nearest_counts_and_what_is_no_measurement_is_unknown() -> None:
    sectors = obstacle_sectors_cm(scan([1, -1, 0, 10, 20], [2.0, 1.5, 0.0, math.nan, 12.0]), np.zeros(3))
    assert sectors[0] == 150
    assert set(sectors[1:]) == {NOTHING_KNOWN_CM}


def test_laser_that_is_mounted_ahead_and_turned() -> None:
    # The laser 0.2 m ahead and 0.1 m left looks to the left; a return 1 m before it stands at (0.2, 1.1) on the car.
    sectors = obstacle_sectors_cm(scan([0], [1.0]), np.array([0.2, 0.1, math.pi / 2]))
    bearing_deg = math.degrees(math.atan2(1.1, 0.2))
    assert [k for k, value in enumerate(sectors) if value != NOTHING_KNOWN_CM] == [round((360 - bearing_deg) / 5)]
    assert min(sectors) == math.floor(100 * math.hypot(0.2, 1.1))
