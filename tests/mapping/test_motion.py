"""The guess where there are no wheels: what scans from a full buffer must not do to it."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.motion import ConstantVelocity

TWIST = np.array([0.5, 0.0, 0.4])  # m/s, rad/s
PERIOD_S = 0.2


def at(seconds: float) -> np.ndarray:
    """Return the pose (3,) of a robot that has driven at TWIST from the origin."""
    return se2.exp(TWIST * seconds)


def driven(stamps_s: list[float]) -> ConstantVelocity:
    """Return a motion that saw scans every PERIOD_S, which came with these stamps."""
    motion = ConstantVelocity()
    for number, stamp_s in enumerate(stamps_s):
        motion.enter(round(stamp_s * 1e9), at(number * PERIOD_S), matched=True)
    return motion


def off_m(guess: np.ndarray, truth: np.ndarray) -> float:
    return float(np.hypot(*(guess - truth)[:2]))


def test_a_steady_stream_gives_the_velocity_and_where_it_leads() -> None:
    motion = driven([number * PERIOD_S for number in range(10)])
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-9)
    np.testing.assert_allclose(motion.predict(at(1.8), round(2.0e9)), at(2.0), atol=1e-9)
    # A scan is missing: the robot has gone on for as long as it took.
    np.testing.assert_allclose(motion.predict(at(1.8), round(2.2e9)), at(2.2), atol=1e-9)


def test_a_late_scan_and_the_next_one_close_behind_it_throw_nobody_across_the_building() -> None:
    stamps = [number * PERIOD_S for number in range(10)]
    stamps[8] = stamps[9] - 0.001
    motion = driven(stamps)
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-6)
    assert off_m(motion.predict(at(1.8), round(2.0e9)), at(2.0)) < 1e-6


def test_in_bursts_each_scan_counts_as_one_period() -> None:
    """Three scans within milliseconds every 0.6 s, as a full buffer gives them out: the intel log is like that."""
    stamps = [0.6 * (number // 3) + 0.001 * (number % 3) for number in range(30)]
    motion = driven(stamps)
    assert np.abs(motion.twist - TWIST).max() < 0.05
    for stamp_s in (stamps[-1] + 0.001, stamps[-1] + 0.6):
        assert off_m(motion.predict(at(29 * PERIOD_S), round(stamp_s * 1e9)), at(30 * PERIOD_S)) < 0.02


def test_a_gap_in_bursts_is_a_gap() -> None:
    motion = driven([0.6 * (number // 3) + 0.001 * (number % 3) for number in range(30)])
    last_s = 5.4 + 0.002
    assert motion.since_match_s(round((last_s + 3.0) * 1e9)) == pytest.approx(3.0, abs=1e-6)


def test_a_velocity_is_not_trusted_for_long() -> None:
    motion = driven([number * PERIOD_S for number in range(10)])
    here = at(1.8)
    motion.enter(round(2.2e9), here, matched=False)
    assert motion.since_match_s(round(2.8e9)) == pytest.approx(1.0)
    np.testing.assert_allclose(motion.predict(here, round(2.8e9)), se2.compose(here, se2.exp(TWIST * 0.1)), atol=1e-9)
    motion.enter(round(2.8e9), here, matched=False)
    np.testing.assert_allclose(motion.predict(here, round(3.0e9)), here, atol=1e-12)


def test_the_velocity_after_a_blind_stretch_is_that_between_the_matches_not_from_the_guess() -> None:
    motion = driven([number * PERIOD_S for number in range(10)])
    for number in range(10, 13):
        motion.enter(round(number * PERIOD_S * 1e9), at(1.8), matched=False)
    motion.enter(round(13 * PERIOD_S * 1e9), at(13 * PERIOD_S), matched=True)
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-9)


def test_after_a_restart_the_robot_stands_but_the_pace_is_known() -> None:
    motion = driven([number * PERIOD_S for number in range(10)])
    motion.restart()
    assert not motion.twist.any()
    motion.enter(round(1.801e9), at(0.0), matched=True)
    motion.enter(round(1.802e9), at(PERIOD_S), matched=True)  # late: a period for all that
    np.testing.assert_allclose(motion.twist, TWIST, atol=1e-9)
