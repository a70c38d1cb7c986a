"""The table of what to expect on a building left out: counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tools.hypothesis_pools import HypothesisPool
from tools.ranking_learning import HeldOut
from tools.ranking_scores import held_out_lines, held_out_probabilities


def pool(buildings: tuple[str, str], *, true: bool, reachable: bool) -> HypothesisPool:
    return HypothesisPool(
        "x", buildings, true, np.zeros((2, 1)), np.array([reachable, False]), np.zeros((2, 2), np.bool_)
    )


HELD_OUT = HeldOut(
    {},
    (
        pool(("hall", "hall"), true=True, reachable=True),
        pool(("hall", "hall"), true=True, reachable=True),
        pool(("hall", "hall"), true=True, reachable=False),
        pool(("hall", "hall"), true=False, reachable=False),
        pool(("hall", "mill"), true=False, reachable=False),
    ),
    np.array([0.99, 0.5, 0.95, 0.2, 0.97]),
    np.array([True, True, False, False, False]),
)


def test_what_is_counted():
    rows = {
        line[:27].strip(): [int(cell) for cell in line[27:].split()] for line in held_out_lines(HELD_OUT, (1, 0))[1:-1]
    }
    assert rows == {
        "hall": [3, 2, 2, 1, 1, 1, 0],
        "two buildings": [0, 0, 0, 0, 0, 1, 1],
        "all": [3, 2, 2, 1, 1, 2, 1],
    }


def test_the_brier_score_is_that_of_the_calibrated_probabilities():
    told = held_out_probabilities(HELD_OUT, (1.0, 0.0))
    assert told == pytest.approx(HELD_OUT.scores)
    brier = float(((told - HELD_OUT.right) ** 2).mean())
    assert f"{brier:.4f}" in held_out_lines(HELD_OUT, (1.0, 0.0))[-1]
    assert (held_out_probabilities(HELD_OUT, (1.0, -2.0)) < told).all()
