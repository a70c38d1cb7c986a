from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.bending import bend_each
from mapping.grid import OccupancyGrid
from mapping.wall_map import WallMap, wall_map

CELL_M = 0.05
HERE = np.zeros((1, 3))


def walls_of(points: np.ndarray) -> WallMap:
    """A grid of 30 x 30 m with wall cells at points (N, 2), free elsewhere."""
    cells = np.full((600, 600), -3.0, np.float32)
    cols, rows = np.floor(points / CELL_M).astype(int).T
    cells[rows, cols] = 3.0
    return wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62)


def rooms() -> np.ndarray:
    """Points each 0.05 m on the walls of rooms of several sizes, from 3 to 27 m."""
    along = np.arange(3.0, 27.0, CELL_M)
    across = [np.column_stack([along, np.full(len(along), y)]) for y in (3.0, 8.0, 14.5, 27.0)]
    down = [np.column_stack([np.full(len(along), x), along]) for x in (3.0, 11.0, 19.0, 27.0)]
    return np.vstack(across + down)


def bent(points: np.ndarray, by_m: float) -> np.ndarray:
    """Points as a map sees them that is bent by so much, 12 m from its middle."""
    x, y = ((points - 15.0) / 12.0).T
    return points + by_m * np.column_stack([y**2 - 0.5, 0.6 * x * y])


def test_a_bent_map_is_brought_onto_the_straight_one():
    straight = rooms()
    crooked = bent(straight, 0.7)
    found = bend_each(walls_of(straight), crooked, np.full(len(crooked), CELL_M), HERE)
    before, after = (np.hypot(*(each - straight).T) for each in (crooked, found.placed[0]))
    assert np.mean(before < 0.12) < 0.3
    assert np.mean(after < 0.12) > 0.95
    assert 0.1 < found.strain_m[0] < 0.7


def test_a_straight_map_is_left_straight():
    straight = rooms()
    off = np.array([[0.15, -0.1, 0.01]])
    found = bend_each(walls_of(straight), straight, np.full(len(straight), CELL_M), off)
    assert np.abs(found.placed[0] - straight).max() < 0.1
    unmoved = bend_each(walls_of(straight), straight, np.full(len(straight), CELL_M), HERE)
    assert unmoved.strain_m[0] < 0.02


def test_what_does_not_belong_together_is_not_bent_together():
    straight = rooms()
    elsewhere = straight[np.random.default_rng(0).permutation(len(straight))[:800]] @ np.array(
        [[0.8, 0.6], [-0.6, 0.8]]
    )
    elsewhere += 15.0 - elsewhere.mean(axis=0)
    walls = walls_of(straight)
    lengths = np.full(len(elsewhere), CELL_M)
    found = bend_each(walls, elsewhere, lengths, HERE)
    cols, rows = np.floor(found.placed[0] / CELL_M).astype(int).clip(0, 599).T
    assert np.mean(walls.distances[rows, cols] < 0.12) < 0.35
    # Held to 0.5 m at 10 m, the walls are neither folded nor shrunk onto one.
    shape = np.linalg.lstsq(np.column_stack([elsewhere, np.ones(800)]), found.placed[0], rcond=None)[0][:2]
    assert np.linalg.svd(shape)[1] == pytest.approx([1.0, 1.0], abs=0.25)


def test_each_pose_is_bent_by_itself():
    straight = rooms()[::7]
    walls, lengths = walls_of(rooms()), np.full(len(straight), 7 * CELL_M)
    poses = np.random.default_rng(1).uniform([-1.0, -1.0, -0.05], [1.0, 1.0, 0.05], (5, 3))
    together = bend_each(walls, straight, lengths, poses)
    for k, pose in enumerate(poses):
        alone = bend_each(walls, straight, lengths, pose[np.newaxis])
        assert np.array_equal(together.placed[k], alone.placed[0])
        assert together.strain_m[k] == alone.strain_m[0]


def test_points_that_meet_nothing_stay_where_the_pose_puts_them():
    pose = np.array([[400.0, 0.0, 0.3]])
    points = rooms()[:50]
    found = bend_each(walls_of(rooms()), points, np.full(50, CELL_M), pose)
    assert found.placed[0] == pytest.approx(se2.transform_points(pose[0], points))
    assert found.strain_m[0] == 0.0
