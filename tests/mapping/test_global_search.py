from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mapping import se2
from mapping.correlation import LikelihoodField, likelihood_field
from mapping.global_search import MOST_POINTS_EVERYWHERE, search_everywhere

CELL_M = 0.1


def walls() -> np.ndarray:
    """Half of a room, so that nothing of it is symmetric."""
    along = np.arange(0.0, 3.0, 0.05)
    return np.vstack(
        [
            np.column_stack([along, np.zeros_like(along)]),
            np.column_stack([np.zeros(40), np.arange(40) * 0.05]),
            np.column_stack([along[:20], np.full(20, 1.0)]),
        ]
    )


def sums(field: LikelihoodField, points: np.ndarray) -> np.ndarray:
    """Return the score of every angle, row and column of the search, by numpy alone."""
    local = points / field.resolution_m
    turns = int(np.ceil(2.0 * np.pi * max(np.sqrt((local**2).sum(axis=1).mean()), 1.0)))
    rows, cols = field.pyramid.shape[1:]
    padded = np.pad(field.pyramid[0].astype(np.int64), 400)
    scores = np.zeros((turns, rows, cols), dtype=np.int64)
    for turn in range(turns):
        turned = se2.transform_points(np.array([0.5, 0.5, turn * 2.0 * np.pi / turns]), local)
        for col, row in np.floor(turned).astype(int):
            scores[turn] += padded[400 + row : 400 + row + rows, 400 + col : 400 + col + cols]
    return scores / (255.0 * len(points))


def everywhere(field: LikelihoodField, points: np.ndarray, **changed: object) -> list:
    settings: dict[str, Any] = {"least_score": 0.0, "least_share": 0.0, "most": 1, "apart_m": 0.5, "apart_rad": 0.3}
    return search_everywhere(field, points, **(settings | changed))


@pytest.mark.parametrize("seed", range(6))
def test_the_best_score_of_all_poses_is_found(seed):
    generator = np.random.default_rng(seed)
    field = likelihood_field(walls(), CELL_M, 0.1)
    points = generator.uniform(-1.5, 1.5, (30, 2))
    assert everywhere(field, points)[0].score == pytest.approx(sums(field, points).max(), abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_second_peak_is_the_best_one_away_from_the_first(seed):
    points = np.random.default_rng(seed).uniform(-1.5, 1.5, (30, 2))
    field = likelihood_field(walls(), CELL_M, 0.1)
    first, second = everywhere(field, points, most=2)
    scores = sums(field, points)
    turns, rows, cols = scores.shape
    at = (first.pose[:2] - field.origin) / CELL_M - 0.5
    turn = round(first.pose[2] / (2.0 * np.pi) * turns) % turns
    col, row = np.rint(at).astype(int)
    steps = np.abs(np.arange(turns) - turn)
    near_turn = np.minimum(steps, turns - steps) <= int(0.3 * turns / (2.0 * np.pi))
    near_row, near_col = np.abs(np.arange(rows) - row) <= 5, np.abs(np.arange(cols) - col) <= 5
    away = ~(near_turn[:, None, None] & near_row[None, :, None] & near_col[None, None, :])
    assert second.score == pytest.approx(scores[away].max(), abs=1e-12)
    assert first.rival == second.score


def test_only_allowed_cells_are_answers():
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (30, 2))
    field = likelihood_field(walls(), CELL_M, 0.1)
    allowed = np.zeros(field.pyramid.shape[1:], np.bool_)
    allowed[7:11, 20:33] = True
    peak = everywhere(field, points, where=allowed)[0]
    assert peak.score == pytest.approx(sums(field, points)[:, allowed].max(), abs=1e-12)
    col, row = np.floor((peak.pose[:2] - field.origin) / CELL_M).astype(int)
    assert allowed[row, col]


@pytest.mark.parametrize("yaw", [0.0, 1.0, 3.1, -2.2])
def test_a_pose_is_recovered_without_a_guess(yaw):
    truth = np.array([1.2, 0.7, yaw])
    field = likelihood_field(walls(), CELL_M, 0.1)
    peak = everywhere(field, se2.transform_points(se2.inverse(truth), walls()))[0]
    assert np.abs(se2.between(truth, peak.pose)).max() < 0.1


def test_thresholds_leave_out_what_is_worse():
    points = se2.transform_points(np.array([-1.2, -0.7, 0.0]), walls())
    field = likelihood_field(walls(), CELL_M, 0.1)
    best = everywhere(field, points)[0].score
    assert everywhere(field, points, least_score=best + 0.01) == []
    close = everywhere(field, points, most=50, least_share=0.8)
    assert 1 <= len(close) < 50
    assert all(peak.score >= 0.8 * best for peak in close)
    assert [peak.score for peak in close] == sorted((peak.score for peak in close), reverse=True)


def test_no_points_and_too_many_points():
    field = likelihood_field(walls(), CELL_M, 0.1)
    assert everywhere(field, np.zeros((0, 2))) == []
    with pytest.raises(ValueError, match="at most 257"):
        everywhere(field, np.zeros((MOST_POINTS_EVERYWHERE + 1, 2)))
    assert len(everywhere(field, np.zeros((MOST_POINTS_EVERYWHERE, 2)))) == 1
