"""Counts of an evaluation: probabilities and covariances, checked on rows that were drawn to be true to them."""

from __future__ import annotations

import numpy as np
import pytest

from tools.registration_scores import calibration, consistency, failure_lines, failures, summary_of, table_of


def calibrated(rows):
    found = calibration(rows)
    assert found is not None
    return found


def row(**changes):
    return {
        "pair": "x",
        "kind": "lidar",
        "band": "low",
        "building_a": "hall",
        "building_b": "hall",
        "true": True,
        "common_wall_m": 10.0,
        "aligned": True,
        "accepted": True,
        "probability": None,
        "acceptance": 0.9,
        "rms_m": 0.02,
        "rotation_deg": 0.1,
        "nees": None,
        "reason": "as told",
        "cpu_s": 1.0,
    } | changes


WRONG = {"true": False, "aligned": False, "band": None, "common_wall_m": None, "rms_m": None, "rotation_deg": None}


def test_a_true_probability_is_calibrated_and_a_boast_is_not():
    random = np.random.default_rng(0)
    p = random.random(8000)
    honest = [
        row(probability=float(each), aligned=bool(right))
        for each, right in zip(p, random.random(8000) < p, strict=True)
    ]
    found = calibrated(honest)
    assert found["brier"] == pytest.approx(1.0 / 6.0, abs=0.01)  # the integral of p (1 - p)
    for fifth in found["fifths"]:
        assert fifth["mean_probability"] == pytest.approx(fifth["right"], abs=0.04)
    assert sum(fifth["pairs"] for fifth in found["fifths"]) == 8000
    assert calibrated([row(probability=1.0, aligned=False)] * 5)["brier"] == 1.0
    assert calibrated([row(probability=1.0), row(probability=0.0, aligned=False)])["brier"] == 0.0


def test_no_probability_at_all_is_no_calibration_and_a_missing_one_is_zero():
    assert calibration([row(), row()]) is None
    assert calibrated([row(probability=1.0), row(aligned=False)])["brier"] == 0.0


def test_errors_drawn_from_the_covariance_are_consistent_with_it():
    random = np.random.default_rng(1)
    found = consistency([row(nees=float((random.standard_normal(3) ** 2).sum())) for _ in range(6000)])
    assert found is not None
    assert found["mean"] == pytest.approx(3.0, abs=0.15)
    assert found["below_7.8"] == pytest.approx(0.95, abs=0.01)
    assert consistency([row()]) is None


def test_false_merges_are_told_by_building_with_a_bound_where_there_is_none():
    rows = [row(**WRONG, accepted=False) for _ in range(30)] + [row(**WRONG, building_b="house") for _ in range(2)]
    found = summary_of(rows)["false_merges"]
    bound = pytest.approx(0.095, abs=5e-4)  # 0.905^30 = 0.05
    assert found["same_building"] == {"pairs": 30, "accepted": 0, "at_most": bound}
    assert found["other_building"] == {"pairs": 2, "accepted": 2, "at_most": None}


def test_the_bound_of_one_wrong_pair_is_a_rate():
    found = summary_of([row(**WRONG, accepted=False)])["false_merges"]
    assert found["all"]["at_most"] == pytest.approx(0.95)


def test_groups_hold_every_true_pair_once():
    rows = [
        row(kind=kind, band=band, common_wall_m=wall_m, building_a=building)
        for kind, band in (("lidar", "low"), ("lidar", "high"), ("camera", "mid"), ("warped", None))
        for wall_m in (0.0, 3.0, 7.9, 20.0, 400.0)
        for building in ("hall", "house")
    ]
    summary = summary_of(rows)
    for key, count in (("by_band", 20), ("by_kind", 40), ("by_common_wall", 30), ("by_building", 40)):
        assert sum(group["pairs"] for group in summary[key].values()) == count
    assert [group["pairs"] for group in summary["by_common_wall"].values()] == [6, 12, 12]


def test_failures_come_worst_first_and_right_answers_not_at_all():
    rows = [
        row(pair="missed", aligned=False, accepted=False),
        row(pair="shy", accepted=False),
        row(pair="right"),
        row(pair="false", **WRONG),
        row(pair="refused", **WRONG, accepted=False),
        row(pair="bad", aligned=False),
    ]
    assert [each["pair"] for each in failures(rows)] == ["false", "bad", "shy", "missed"]
    assert [line.split()[0] for line in failure_lines(summary_of(rows))] == [
        "wrong,",
        "wrong,",
        "right,",
        "misaligned,",
    ]


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [row()],
        [row(**WRONG)],
        [row(aligned=False, accepted=False, rms_m=None, rotation_deg=None)],
        [row(probability=0.9, nees=2.0), row(**WRONG, probability=0.1, accepted=False)],
    ],
)
def test_a_table_can_be_made_of_any_rows(rows):
    lines = table_of(summary_of(rows))
    assert lines[1].startswith("all true pairs")
    assert max(map(len, lines)) <= 120
