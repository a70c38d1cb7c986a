"""What makes a pose believable, and what speaks against it."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.verification import AcceptanceRule, Agreement, compare, objection
from mapping import se2

RULE = AcceptanceRule(min_inliers=10, min_acceptance=0.9, min_wall_m=5.0, max_conflict=0.2)
GOOD = Agreement(acceptance=0.99, overlap=0.5, wall_m=20.0, conflict=0.02)
POSE = np.array([-4.0, 3.0, 1.1])


def test_the_true_pose_of_two_views_agrees(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, POSE, 2)
    agreement = compare(a, b, se2.inverse(POSE))
    assert objection(agreement, 100, RULE) is None
    assert agreement.acceptance > 0.95
    assert agreement.conflict < 0.05
    assert agreement.overlap == pytest.approx(11.0 / 20.0, abs=0.03)


def test_both_orders_agree_alike_at_one_resolution(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, POSE, 2)
    there, back = compare(a, b, se2.inverse(POSE)), compare(b, a, POSE)
    assert there.acceptance == pytest.approx(back.acceptance, abs=0.01)
    assert there.wall_m == pytest.approx(back.wall_m, rel=0.05)


def test_a_pose_off_by_two_metres_puts_walls_into_seen_free_space(view):
    a, b = view(0.0, 20.0, np.zeros(3), 1), view(9.0, 30.0, POSE, 2)
    wrong = se2.compose(se2.inverse(POSE), np.array([1.5, 1.3, 0.0]))
    assert compare(a, b, wrong).conflict > 0.2


def test_a_coarse_map_keeps_the_thin_walls_of_a_fine_one(view):
    fine, coarse = view(0.0, 20.0, np.zeros(3), 1, 0.02), view(9.0, 30.0, POSE, 2, 0.10)
    assert compare(fine, coarse, se2.inverse(POSE)).wall_m > 20.0


def test_maps_that_do_not_touch_have_nothing_in_common(view):
    a = view(0.0, 12.0, np.zeros(3), 1)
    assert compare(a, a, np.array([500.0, 0.0, 0.0])) == Agreement(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("agreement", "inliers", "words"),
    [
        (GOOD, 9, "9 matches"),
        (Agreement(0.8, 0.5, 20.0, 0.0), 50, "acceptance index is 0.800"),
        (Agreement(0.99, 0.5, 3.0, 0.0), 50, "3.0 m of wall"),
        (Agreement(0.99, 0.5, 20.0, 0.47), 50, "47% of the walls"),
    ],
)
def test_each_condition_objects_by_itself(agreement, inliers, words):
    assert words in str(objection(agreement, inliers, RULE))
    assert objection(GOOD, 10, RULE) is None
