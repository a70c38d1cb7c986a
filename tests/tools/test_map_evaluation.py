"""`evaluate maps`: how the verdicts are given, and the whole of it on real maps."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.registration import register
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.map_evaluation import judged
from tools.map_pairs import MapPair, PairTruth, map_pairs

TRUTH = np.array([8.0, -5.0, 2.0])
GRID = OccupancyGrid(np.full((2, 2), -2.0, np.float32), 0.05, np.zeros(3))
POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2))
SAME = MapPair("same", GRID, GRID, PairTruth(TRUTH, se2.transform_points(TRUTH, POINTS), POINTS))
OTHER = MapPair("other", GRID, GRID)


@pytest.mark.parametrize(
    ("pair", "shift_m", "accepted", "verdict", "precise"),
    [
        (SAME, 0.05, True, "right", True),
        (SAME, 0.3, True, "right", False),
        (SAME, 0.6, True, "WRONG", False),
        (SAME, 0.05, False, "refused, pose was right", False),
        (SAME, 0.6, False, "refused", False),
        (OTHER, 0.0, True, "WRONG", False),
        (OTHER, 0.0, False, "refused", False),
    ],
)
def test_a_verdict_is_what_it_says(pair, shift_m, accepted, verdict, precise):
    row = judged(pair, Alignment(TRUTH + np.array([0.0, shift_m, 0.0]), accepted, "as told"))
    assert (row["verdict"], row["precise"]) == (verdict, precise)


def test_a_turn_of_four_degrees_is_wrong_however_near():
    row = judged(SAME, Alignment(TRUTH + np.array([0.0, 0.0, np.radians(4.0)]), True, "as told"))
    assert row["verdict"] == "WRONG"
    assert row["rotation_deg"] == pytest.approx(4.0, abs=0.001)


def test_no_pose_at_all_is_a_refusal():
    assert judged(SAME, Alignment(None, False, "as told"))["verdict"] == "refused"


def test_a_folder_without_data_is_one_line(cli, tmp_path):
    for folder in (tmp_path, tmp_path / "none"):
        outcome = cli("evaluate", "maps", "--data", folder)
        assert (outcome.code, len(outcome.error_lines)) == (1, 1)


@pytest.mark.real_data
def test_real_maps_are_right_or_refused_never_wrong(data_dir):
    """Two of the five logs; `evaluate maps` does them all, in minutes."""
    pairs = list(itertools.islice(map_pairs(data_dir, 0), 6))
    rows = [judged(pair, register(pair.a, pair.b, "default", 0)) for pair in pairs]
    verdicts = Counter(row["verdict"] for row in rows)
    assert verdicts["WRONG"] == 0
    assert verdicts["right"] >= 2  # features alone: what overlaps by less than 60 % is mostly refused
