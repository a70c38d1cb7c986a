from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.correlation import LikelihoodField, SearchWindow, likelihood_field, search

CELL_M = 0.1


def walls(seed: int = 3) -> np.ndarray:
    """A room's outline with clutter in it."""
    generator = np.random.default_rng(seed)
    along = np.arange(0.0, 4.0, 0.05)
    outline = np.vstack(
        [
            np.column_stack([along, np.zeros_like(along)]),
            np.column_stack([along, np.full_like(along, 3.0)]),
            np.column_stack([np.zeros(60), np.arange(60) * 0.05]),
        ]
    )
    return np.vstack([outline, generator.uniform((0.0, 0.0), (4.0, 3.0), (15, 2))])


def score_at(field: LikelihoodField, points: np.ndarray, pose: np.ndarray, shift: tuple[int, int]) -> float:
    """Return the mean likelihood, by numpy: points turned, cut to cells, then shifted by whole cells."""
    moved = (se2.transform_points(pose, points) - field.origin) / field.resolution_m
    cells = np.floor(moved).astype(int) + shift
    rows, cols = field.pyramid.shape[1:]
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < cols) & (cells[:, 1] < rows)
    return float(field.pyramid[0][cells[inside, 1], cells[inside, 0]].sum() / (255.0 * len(points)))


def brute_force(field: LikelihoodField, points: np.ndarray, guess: np.ndarray, window: SearchWindow) -> float:
    step = field.resolution_m / max(float(np.hypot(*points.T).max()), 1.0)
    turns = int(np.ceil(window.angular_rad / step))
    cells = int(np.ceil(window.linear_m / field.resolution_m))
    return max(
        score_at(field, points, guess + np.array([0.0, 0.0, turn * step]), (dx, dy))
        for turn in range(-turns, turns + 1)
        for dx in range(-cells, cells + 1)
        for dy in range(-cells, cells + 1)
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_best_score_of_the_window_is_found(seed):
    generator = np.random.default_rng(seed)
    field = likelihood_field(walls(), CELL_M, 0.1)
    points = generator.uniform(-1.5, 1.5, (25, 2))
    guess = np.array([*generator.uniform(-0.5, 3.5, 2), generator.uniform(-3.0, 3.0)])
    window = SearchWindow(0.7, 0.3)
    peak = search(field, points, guess, window, least_score=0.0)
    assert peak is not None
    assert peak.score == pytest.approx(brute_force(field, points, guess, window), abs=1e-12)


def test_a_known_motion_is_recovered_to_a_cell():
    field = likelihood_field(walls(), 0.05, 0.08)
    truth = np.array([1.3, 0.9, 0.4])
    points = se2.transform_points(se2.inverse(truth), walls())
    peak = search(
        field, points, truth + np.array([0.3, -0.2, 0.15]), SearchWindow(0.5, 0.3), least_score=0.3, rival_apart_m=0.4
    )
    assert peak is not None
    assert np.abs(se2.between(truth, peak.pose)[:2]).max() < 0.06
    assert abs(se2.between(truth, peak.pose)[2]) < 0.02
    assert 0.0 < peak.rival < peak.score


def test_nothing_below_the_least_score_is_returned():
    field = likelihood_field(walls(), CELL_M, 0.1)
    far = np.array([50.0, 50.0, 0.0])
    assert search(field, walls(), far, SearchWindow(0.5, 0.2), least_score=0.1) is None
    assert search(field, np.zeros((0, 2)), np.zeros(3), SearchWindow(0.5, 0.2), least_score=0.0) is None


def test_every_level_bounds_the_squares_of_the_one_below():
    field = likelihood_field(walls(), CELL_M, 0.1)
    for level in range(1, len(field.pyramid)):
        side = 1 << level
        for row, col in ((0, 0), (5, 9), (12, 3)):
            assert field.pyramid[level, row, col] == field.pyramid[0, row : row + side, col : col + side].max()


def test_the_field_covers_what_it_is_told_to():
    small = likelihood_field(np.zeros((1, 2)), CELL_M, 0.1)
    large = likelihood_field(np.zeros((1, 2)), CELL_M, 0.1, cover=np.array([[-3.0, 0.0], [0.0, 5.0]]))
    assert (large.origin <= np.array([-3.0, 0.0])).all()
    assert large.pyramid.shape[1] * CELL_M + large.origin[1] >= 5.0
    assert small.pyramid.max() == large.pyramid.max() == 255
