"""The compiled rectangle test against geometry done another way."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from planning.footprint import clearance_m, is_free

BODY = (0.34, 0.085, 0.096)
CELL_M = 0.05
SHAPE = (60, 60)


def distances(mask: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M)


def sampled_clearance_m(mask: np.ndarray, pose: np.ndarray) -> float:
    """Distance from densely sampled points of the rectangle to the squares of blocked cells."""
    along, across = np.meshgrid(np.linspace(-BODY[1], BODY[0], 200), np.linspace(-BODY[2], BODY[2], 100))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x = pose[0] + cos * along.ravel() - sin * across.ravel()
    y = pose[1] + sin * along.ravel() + cos * across.ravel()
    best = np.inf
    for row, col in np.argwhere(mask):
        u = np.maximum(np.abs(x - (col + 0.5) * CELL_M) - CELL_M / 2, 0.0)
        v = np.maximum(np.abs(y - (row + 0.5) * CELL_M) - CELL_M / 2, 0.0)
        best = min(best, float(np.hypot(u, v).min()))
    return best


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_dense_sampling(seed):
    random = np.random.default_rng(seed)
    mask = np.zeros(SHAPE, bool)
    mask[tuple(random.integers(18, 42, (2, 6)))] = True
    pose = np.array([*random.uniform(1.2, 1.8, 2), random.uniform(-4, 4)])
    expected = sampled_clearance_m(mask, pose)
    free = is_free(mask, distances(mask), CELL_M, float(pose[0]), float(pose[1]), float(pose[2]), BODY)
    if expected > 0.004:  # the samples lie that far apart
        assert free
        measured = clearance_m(mask, distances(mask), CELL_M, pose[np.newaxis], BODY)
        assert measured == pytest.approx(expected, abs=0.003)
    elif expected == 0.0:
        assert not free


@pytest.mark.parametrize("pose", [(0.05, 1.5, 0.0), (2.7, 1.5, 0.0), (1.5, 2.75, np.pi / 2), (-5.0, 1.0, 0.0)])
def test_a_car_across_the_edge_of_the_map_is_not_free(pose):
    mask = np.zeros(SHAPE, bool)
    assert not is_free(
        mask, np.full(SHAPE, 1e6, np.float32), CELL_M, float(pose[0]), float(pose[1]), float(pose[2]), BODY
    )


def test_nothing_occupied_is_infinitely_far():
    mask = np.zeros(SHAPE, bool)
    assert clearance_m(mask, np.full(SHAPE, 1e6, np.float32), CELL_M, np.array([[1.5, 1.5, 0.3]]), BODY) == np.inf


def test_the_least_clearance_along_a_path_is_found_wherever_it_is():
    mask = np.zeros((60, 200), bool)
    mask[25, 150] = True
    poses = np.column_stack([np.linspace(1.0, 9.0, 300), np.full(300, 1.0), np.zeros(300)])
    measured = clearance_m(mask, distances(mask), CELL_M, poses, BODY)
    assert measured == pytest.approx(1.25 - 1.0 - BODY[2], abs=1e-6)
