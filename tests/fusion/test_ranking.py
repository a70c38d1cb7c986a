from __future__ import annotations

import json

import numpy as np
import pytest

from fusion.errors import FusionError
from fusion.evidence import TRENDS
from fusion.ranking import FORMAT, SHIPPED, VERSION, probabilities, ranking_from, read_ranking, shipped_ranking

STORED = {
    "format": FORMAT,
    "version": VERSION,
    "origin": "a test",
    "features": ["hits", "conflicts"],
    "base": -1.0,
    "slope": 2.0,
    "offset": 0.5,
    "trees": [
        {
            "if": "hits",
            "at_most": 2.0,
            "then": -0.5,
            "else": {"if": "conflicts", "at_most": 1.0, "then": 1.5, "else": 0.25},
        },
        0.125,
    ],
}


def by_hand(hits: float, conflicts: float) -> float:
    """What the trees above say."""
    return -1.0 + (-0.5 if hits <= 2.0 else 1.5 if conflicts <= 1.0 else 0.25) + 0.125


def test_trees_are_read_as_they_stand():
    ranking = ranking_from(STORED)
    hits, conflicts = np.array([0.0, 2.0, 2.1, 9.0]), np.array([0.0, 5.0, 1.0, 1.1])
    expected = [by_hand(*each) for each in zip(hits, conflicts, strict=True)]
    assert ranking.log_odds({"conflicts": conflicts, "hits": hits}).tolist() == pytest.approx(expected)


def test_calibration_is_a_logistic_curve_of_the_scores_log_odds():
    ranking = ranking_from(STORED)
    assert ranking.calibrated(0.5) == pytest.approx(1.0 / (1.0 + np.exp(-0.5)))
    assert ranking.calibrated(0.0) < 1e-6
    assert ranking.calibrated(1.0) > 1.0 - 1e-6
    assert probabilities(np.array([0.0])).tolist() == [0.5]


@pytest.mark.parametrize("change", [{"version": VERSION + 1}, {"format": "other"}, {"trees": 3}, {"features": None}])
def test_other_files_are_refused_in_one_line(tmp_path, change):
    path = tmp_path / "weights.json"
    path.write_text(json.dumps(STORED | change))
    with pytest.raises(FusionError, match="weights.json") as refused:
        read_ranking(path)
    assert "\n" not in str(refused.value)


def test_the_shipped_weights_know_the_evidence_and_say_where_they_are_from():
    ranking = shipped_ranking()
    assert set(ranking.names) <= set(TRENDS)
    assert ranking.origin
    assert SHIPPED.stat().st_size < 300_000


def test_the_shipped_weights_never_fall_with_more_agreement_nor_rise_with_more_contradiction():
    ranking = shipped_ranking()
    random = np.random.default_rng(5)
    steps = np.linspace(-1.0, 6.0, 15)
    for name in ranking.names:
        others = {each: np.repeat(random.uniform(0.0, 4.0), len(steps)) for each in ranking.names}
        slope = np.diff(ranking.log_odds(others | {name: steps}))
        assert (slope * TRENDS[name] >= 0.0).all() or TRENDS[name] == 0, name
