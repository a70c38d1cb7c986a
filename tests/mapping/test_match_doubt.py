from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.match_doubt import DoubtSettings, agreement_with, is_surprising, is_weak, rescue
from mapping.scan_matching import Agreement, Group

LIMITS = DoubtSettings()
LAST = 12  # of the keyframes; the next one is the scan that is doubted


@pytest.fixture(scope="module")
def seen(building, lap_poses):
    """The clouds, the ten keyframes before the scan in the frame of the lap, and where the scan was made."""
    recent = np.arange(LAST - 9, LAST + 1)
    return building.keyframes(lap_poses[: LAST + 2]).snapshot(), Group(recent, lap_poses[recent]), lap_poses[LAST + 1]


def test_the_true_pose_agrees_with_what_was_seen_and_a_wrong_one_does_not(seen):
    clouds, recent, true_pose = seen
    right = agreement_with(clouds, LAST + 1, true_pose, recent)
    wrong = agreement_with(clouds, LAST + 1, se2.compose(true_pose, np.array([0.0, 0.4, 0.3])), recent)
    assert not is_weak(right, LIMITS, surprising=True)
    assert is_weak(wrong, LIMITS, surprising=True)
    assert wrong.hits < right.hits


def test_a_surprising_match_needs_more(seen):
    middling = Agreement(hits=75, conflicts=25, hidden=0)
    assert not is_weak(middling, LIMITS, surprising=False)
    assert is_weak(middling, LIMITS, surprising=True)
    assert is_weak(Agreement(hits=5, conflicts=0, hidden=95), LIMITS, surprising=False)  # hardly anything in common


@pytest.mark.parametrize(
    ("correction", "expected"),
    [((0.1, 0.1, 0.1), False), ((0.2, 0.0, 0.0), True), ((0.0, -0.2, 0.0), True), ((0.0, 0.0, -0.2), True)],
)
def test_what_lies_far_from_the_guess_is_surprising(correction, expected):
    assert is_surprising(np.array(correction), LIMITS) is expected


def test_a_guess_that_is_off_is_mended_within_the_reach_and_not_beyond(seen):
    clouds, recent, true_pose = seen
    guess = se2.compose(true_pose, np.array([0.6, -0.4, 0.7]))
    found = rescue(clouds, LAST + 1, guess, recent, 0.1, LIMITS)
    assert found is not None
    off = se2.between(true_pose, found)
    assert np.hypot(off[0], off[1]) < 0.03
    assert abs(off[2]) < np.radians(1.0)
    narrow = DoubtSettings(rescue_m=0.1, rescue_m_per_s=0.0, rescue_rad=0.1, rescue_rad_per_s=0.0)
    assert rescue(clouds, LAST + 1, guess, recent, 0.1, narrow) is None
