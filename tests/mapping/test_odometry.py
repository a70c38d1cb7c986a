from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mapping import se2
from mapping.odometry import LidarOdometry, OdometrySettings
from mapping.raycast import cast_rays

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROOM_CELL_M = 0.02
HOME = np.array([3.0, 2.5, 0.4])


def scan_at(room: Mask, pose: FloatArray, count: int = 400) -> FloatArray:
    """Return the walls as points (N, 2) in the body frame at a pose in the room, without noise or motion."""
    angles = -2.0 * np.pi * np.arange(count) / count
    starts = np.tile(pose[:2] / ROOM_CELL_M, (count, 1))
    ranges = cast_rays(room, starts, pose[2] + angles, 1e3) * ROOM_CELL_M
    return ranges[:, np.newaxis] * np.column_stack([np.cos(angles), np.sin(angles)])


def odometry_with_map(room: Mask) -> LidarOdometry:
    """Return odometry that has seen the room from HOME, which becomes the origin of its frame."""
    odometry = LidarOdometry(OdometrySettings())
    odometry.learn(scan_at(room, HOME), np.zeros(3))
    return odometry


def test_first_scan_defines_the_frame(room: Mask) -> None:
    guess = np.array([1.0, 2.0, 0.3])
    match = LidarOdometry(OdometrySettings()).match(scan_at(room, HOME), guess)
    assert match.accepted
    np.testing.assert_array_equal(match.pose, guess)


@pytest.mark.parametrize(
    "motion", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.05, -0.05, 0.05), (0.0, 0.1, -0.1), (-0.15, 0.05, 0.15)]
)
def test_known_motion_is_recovered_from_no_guess_at_all(motion: tuple[float, float, float], room: Mask) -> None:
    true = np.array(motion)
    match = odometry_with_map(room).match(scan_at(room, se2.compose(HOME, true)), np.zeros(3))
    assert match.accepted
    error = se2.between(true, match.pose)
    # The map keeps ten points a voxel of 0.5 m, 16 cm apart: points pair with neighbours up to 8 cm along the wall.
    # Over 400 points of all walls that averages out to about 1 cm and 0.3 deg (less once more scans have been learnt).
    assert np.hypot(error[0], error[1]) < 0.02
    assert abs(error[2]) < np.radians(0.6)
    np.testing.assert_allclose(match.correction, match.pose, atol=1e-12)  # seen from the guess, here the origin


def test_matching_changes_nothing_and_repeats_bit_for_bit(room: Mask) -> None:
    odometry, points = odometry_with_map(room), scan_at(room, se2.compose(HOME, [0.1, 0.05, 0.1]))
    first = odometry.match(points, np.zeros(3))
    again = odometry.match(points, np.zeros(3))
    np.testing.assert_array_equal(first.pose, again.pose)


def test_too_few_measurements_keep_the_guess_and_say_so(room: Mask) -> None:
    guess = np.array([0.3, 0.0, 0.1])
    for points in (scan_at(room, HOME)[:29], np.zeros((0, 2))):
        match = odometry_with_map(room).match(points, guess)
        assert not match.accepted
        assert match.reason == f"{len(points)} measurements, 30 needed"
        np.testing.assert_array_equal(match.pose, guess)


def test_a_match_far_from_the_guess_is_not_believed(room: Mask) -> None:
    odometry = LidarOdometry(OdometrySettings(max_correction_m=0.05))
    odometry.learn(scan_at(room, HOME), np.zeros(3))
    match = odometry.match(scan_at(room, se2.compose(HOME, [0.15, 0.0, 0.0])), np.zeros(3))
    assert not match.accepted
    assert "off the guess" in match.reason
    np.testing.assert_array_equal(match.pose, np.zeros(3))
    assert np.hypot(match.correction[0], match.correction[1]) > 0.05
