from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from tools.simulated_wheels import WheelNoise, wheel_odometry
from tools.simulator import drive_along
from tools.world import OFFICE_TOUR

PERFECT = WheelNoise(0.0, 0.0, 0.0, 0.0, 0.0)
DRIVE = drive_along(OFFICE_TOUR)


def poses_of(messages):
    return np.array([message.pose for message in messages])


def test_perfect_wheels_tell_the_drive_as_seen_from_its_start():
    messages = wheel_odometry(DRIVE, PERFECT, 3)
    assert [message.stamp_ns for message in messages] == DRIVE.stamps_ns.tolist()
    off = se2.between(poses_of(messages), se2.between(DRIVE.poses[0], DRIVE.poses))
    assert np.abs(off).max() < 1e-6
    twists = np.array([message.twist for message in messages[1:]])
    seconds = np.diff(DRIVE.stamps_ns)[:, np.newaxis] * 1e-9
    rebuilt = se2.compose(poses_of(messages)[:-1], se2.exp(twists * seconds))
    np.testing.assert_allclose(se2.between(rebuilt, poses_of(messages)[1:]), 0.0, atol=1e-9)


def test_errors_repeat_with_the_seed_only():
    one, same, other = (poses_of(wheel_odometry(DRIVE, WheelNoise(), seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


@pytest.mark.parametrize(
    ("noise", "way_sigma", "turn_sigma_rad"),
    [
        (WheelNoise(0.02, 0.0, 0.0, 0.0, 0.0), 0.02, 0.0),
        (WheelNoise(0.0, 0.0, 0.0, 0.002, 0.0), 0.0, 0.002 * float(np.ptp(DRIVE.stamps_ns)) * 1e-9),
    ],
)
def test_errors_are_as_large_as_they_say(noise, way_sigma, turn_sigma_rad):
    ways, turns = [], []
    true_turn = np.unwrap(DRIVE.poses[:, 2])[-1] - DRIVE.poses[0, 2]
    for seed in range(30):
        poses = poses_of(wheel_odometry(DRIVE, noise, seed))
        steps = np.diff(poses[:, :2], axis=0)
        ways.append(np.hypot(*steps.T).sum() / DRIVE.length_m - 1.0)
        turns.append(np.unwrap(poses[:, 2])[-1] - true_turn)
    assert np.std(ways) == pytest.approx(way_sigma, rel=0.3, abs=1e-4)
    assert np.std(turns) == pytest.approx(turn_sigma_rad, rel=0.3, abs=1e-4)
