"""What each way would have merged, told from finished rows."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.readiness import ReadinessRule
from mapping import se2
from mapping.map_io import write_lossless
from tools.growing_steps import DEFAULT, enough_from, merged_from, outcomes, truth_row, way_row

TRUE = np.array([1.0, 2.0, 0.5])
POINTS = [[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]]


def row(pose, step, accepted=True, common_m=30.0):
    return {
        "points_b": POINTS,
        "common_free_m2": common_m,
        "common_wall_m": common_m,
        "error_points_b": POINTS,
        DEFAULT: {
            "accepted": accepted,
            "T_a_b": None if pose is None else list(pose),
            "probability": 0.99,
            "inliers": 9,
            "acceptance": 0.98,
            "common_wall_m": 20.0 + 10.0 * step,
            "conflict_m": 0.0,
            "reason": "sure",
        },
    }


WRONG = np.add(TRUE, (4.0, 0.0, 0.0))


def test_each_verdict_at_once_merges_wrongly_where_the_settled_rule_does_not():
    rows = [row(WRONG, 0), row(None, 1, accepted=False), *(row(TRUE, step) for step in range(2, 7))]
    at_once = outcomes(rows, DEFAULT, TRUE, None)
    assert [step.right for step in at_once] == [False, None, True, True, True, True, True]
    settled = outcomes(rows, DEFAULT, TRUE, ReadinessRule())
    assert [step.merged for step in settled] == [False, False, False, False, True, True, True]
    assert all(step.right is not False for step in settled)
    assert (merged_from(at_once), merged_from(settled)) == (0, 4)
    assert at_once[0].error is not None
    assert at_once[0].error.rms_m == pytest.approx(4.0)
    assert settled[3].moved_m == pytest.approx(0.0)


def test_a_turn_of_more_than_three_degrees_is_wrong_however_near_it_is():
    turned = se2.compose(TRUE, np.array([0.0, 0.0, np.radians(3.5)]))
    (step,) = outcomes([row(turned, 0)], DEFAULT, TRUE, None)
    assert step.merged_error is not None
    assert step.merged_error.rms_m < 0.5
    assert step.right is False


def test_any_merge_of_two_places_is_wrong():
    rows = [{**row(TRUE, step), "error_points_b": None} for step in range(5)]
    assert [step.right for step in outcomes(rows, DEFAULT, None, None)] == [False] * 5


def test_enough_is_wall_and_free_space_in_truth():
    rows = [row(TRUE, 0, common_m=7.0), row(TRUE, 1, common_m=12.0), row(TRUE, 2, common_m=16.0)]
    assert enough_from(rows) == 2
    assert enough_from(rows[:2]) is None


def test_a_row_holds_the_truth_and_what_was_found(tmp_path, rooms_part, true_pose):
    files = []
    for name, part in (("a", rooms_part(1, 0, 220)), ("b", rooms_part(2, 90, 320, np.array([6.0, -3.0, 2.2])))):
        write_lossless(tmp_path / f"{name}.npz", part)
        files.append(tmp_path / f"{name}.npz")
    truth = truth_row(files[0], files[1], true_pose)
    assert truth["common_free_m2"] == pytest.approx(6.5 * 12.0 * 0.8, rel=0.25)
    assert truth["common_wall_m"] > 20.0
    found = way_row(files[0], files[1], DEFAULT, 0)
    assert found["accepted"]
    (step,) = outcomes([{**truth, DEFAULT: found}], DEFAULT, true_pose, None)
    assert step.right is True
    apart = truth_row(files[0], files[1], None)
    assert (apart["common_free_m2"], apart["error_points_b"]) == (0.0, None)
