"""When a pair of growing maps is merged, kept, and taken apart again."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.readiness import GrowingPair, ReadinessRule, Version, moved_m
from mapping import se2

POINTS = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
RULE = ReadinessRule(versions=3, moved_m=0.3, grown_m=3.0, conflict=0.1, patience=3)
HERE, ELSEWHERE = (1.0, 2.0, 0.5), (9.0, 2.0, 0.5)


def found(pose, accepted=True):
    return Alignment(None if pose is None else np.array(pose), accepted, "sure" if accepted else "not sure enough")


def grown(*alignments, pair=None, wall_m=10.0, by_m=5.0, conflict_m=0.0, finished=False):
    """The pair after registrations in each of which more wall agrees than in the one before."""
    pair = pair or GrowingPair()
    for number, alignment in enumerate(alignments):
        version = Version(alignment, wall_m + number * by_m, conflict_m)
        pair = pair.registered(version, POINTS, RULE, finished=finished)
    return pair


def test_three_sure_versions_at_one_place_are_merged_and_not_before():
    two = grown(found(HERE), found(HERE))
    assert two.merged is None
    assert not two.believed.accepted
    assert "2 of 3 times in a row" in two.reason
    three = grown(found(HERE), pair=two, wall_m=20.0)
    assert three.merged is not None
    assert three.believed.accepted
    np.testing.assert_array_equal(three.believed.T_a_b, HERE)


def test_a_place_at_which_nothing_new_comes_to_agree_is_not_believed_however_often_it_is_found():
    """As two corridors that look alike: their registration stays, while the robots drive on elsewhere."""
    pair = grown(*[found(HERE)] * 20, by_m=0.1)
    assert pair.merged is None
    assert len(pair.versions) == 1


def test_sure_verdicts_that_jump_about_are_no_merge():
    pair = grown(found(HERE), found(ELSEWHERE), found(HERE), found(ELSEWHERE), found(HERE))
    assert pair.merged is None
    assert "1 of 3 times in a row" in pair.reason


def test_a_slow_drift_is_seen_over_all_versions():
    steps = [found((1.0 + 0.2 * number, 2.0, 0.5)) for number in range(6)]
    assert grown(*steps).merged is None  # 0.2 m from one to the next, 0.4 m over three


def test_a_turn_counts_by_what_it_moves():
    turned = found(se2.compose(np.array(HERE), np.array([0.0, 0.0, 0.04])))
    assert moved_m(found(HERE), turned, POINTS) == pytest.approx(0.4, rel=0.05)
    assert grown(found(HERE), turned, found(HERE), turned).merged is None


def test_a_refusal_in_between_begins_the_count_anew():
    pair = grown(found(HERE), found(HERE), found(HERE, accepted=False), found(HERE), found(HERE))
    assert pair.merged is None
    assert grown(found(HERE), pair=pair, wall_m=50.0).merged is not None


def test_walls_that_contradict_are_a_refusal_though_the_verdict_accepts():
    pair = grown(*[found(HERE)] * 5, conflict_m=4.0)
    assert pair.merged is None, "4 of 30 m contradict at last, and 4 of 10 at first"
    assert "too much contradicts" in grown(found(HERE), conflict_m=4.0).reason
    assert grown(*[found(HERE)] * 3, conflict_m=0.9).merged is not None


def test_finished_maps_have_nothing_to_wait_for():
    assert grown(found(HERE), finished=True).merged is not None
    assert grown(found(HERE, accepted=False), finished=True).merged is None
    assert grown(found(HERE), finished=True, conflict_m=2.0).merged is None


@pytest.mark.parametrize("accepted", [True, False])
def test_a_merge_is_withdrawn_at_once_when_a_version_says_another_place(accepted):
    merged = grown(*[found(HERE)] * 3)
    after = grown(found(ELSEWHERE, accepted=accepted), pair=merged, wall_m=25.0)
    assert after.merged is None
    assert not after.believed.accepted
    assert "another place, 8.00 m away" in after.withdrawn
    back = grown(found(HERE), found(HERE), pair=after, wall_m=30.0)
    assert back.merged is None, "what was withdrawn is to be earned anew"
    assert back.withdrawn
    whole = grown(found(HERE), pair=back, wall_m=40.0)
    assert whole.merged is not None
    assert not whole.withdrawn


def test_a_merge_outlives_some_unsure_versions_at_its_place_but_not_many():
    merged = grown(*[found(HERE)] * 3)
    unsure = grown(*[found(HERE, accepted=False)] * 2, pair=merged, wall_m=25.0)
    assert unsure.merged is not None
    assert "would be refused" in unsure.reason
    assert grown(found(HERE), pair=unsure, wall_m=35.0).refused == 0
    lost = grown(found(HERE, accepted=False), pair=unsure, wall_m=35.0)
    assert lost.merged is None
    assert "refused 3 times in a row" in lost.withdrawn


def test_a_version_without_any_place_withdraws_a_merge():
    after = grown(found(None, accepted=False), pair=grown(*[found(HERE)] * 3), wall_m=25.0)
    assert after.merged is None
    assert "no place at all" in after.withdrawn


def test_a_merge_follows_small_motion_as_maps_bend():
    pair = grown(*[found(HERE)] * 3)
    for number in range(1, 6):
        pair = grown(found((1.0 + 0.2 * number, 2.0, 0.5)), pair=pair, wall_m=20.0)
    assert pair.merged is not None
    np.testing.assert_allclose(pair.merged.T_a_b, (2.0, 2.0, 0.5))


def test_the_default_method_s_figures_are_taken_over():
    alignment = Alignment(np.array(HERE), True, "sure", common_wall_m=12.0, conflict_m=0.5)
    version = Version.of(alignment)
    assert (version.wall_m, version.conflict_m) == (12.0, 0.5)
    assert not Version.of(found(None, accepted=False)).is_sure(RULE)
