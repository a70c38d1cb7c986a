from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_matching import covariance_of, judge, refine, structure
from mapping.wall_map import FAR_M, FREE, UNKNOWN, WALL, wall_map

CELL_M = 0.05


def box() -> OccupancyGrid:
    """A free room of 4 x 3 m with walls of one cell, unknown around it."""
    cells = np.zeros((80, 100), np.float32)
    cells[10:71, 10:91] = -3.0
    cells[[10, 70], 10:91] = cells[10:71, [10, 90]] = 3.0
    return OccupancyGrid(cells, CELL_M, np.zeros(3))


def outline() -> np.ndarray:
    """Points on the walls' middle, two a cell."""
    x, y = np.arange(10.5, 90.5, 0.5), np.arange(10.5, 70.5, 0.5)
    sides = [
        np.column_stack([x, np.full_like(x, 10.5)]),
        np.column_stack([x, np.full_like(x, 70.5)]),
        np.column_stack([np.full_like(y, 10.5), y]),
        np.column_stack([np.full_like(y, 90.5), y]),
    ]
    return np.vstack(sides) * CELL_M


def test_states_and_distances_follow_the_map():
    reference = wall_map(box(), free_below=-0.4)
    assert reference.states[0, 0] == UNKNOWN
    assert reference.states[10, 50] == WALL
    assert reference.states[40, 50] == FREE
    assert reference.distances[10, 50] == 0.0
    assert reference.distances[14, 50] == pytest.approx(4 * CELL_M)
    assert reference.distances.max() <= FAR_M


@pytest.mark.parametrize("off", [[0.3, 0.0, 0.0], [-0.2, 0.25, 0.1], [0.0, -0.3, -0.15]])
def test_refinement_reaches_the_pose_below_a_cell(off):
    truth = np.array([2.4, 2.0, 0.3])
    points = se2.transform_points(se2.inverse(truth), outline())
    fit = refine(wall_map(box(), free_below=-0.4), points, se2.compose(truth, off))
    error = se2.between(truth, fit.pose)
    assert np.abs(error[:2]).max() < 0.01
    assert abs(error[2]) < 0.01
    assert fit.hits == 1.0


def test_evidence_counts_what_points_say():
    reference = wall_map(box(), free_below=-0.4)
    start = np.array([2.5, 2.0])
    ends = np.array([[0.525, 2.0], [2.5, 0.525], [3.2, 2.0], [0.1, 2.0], [4.3, 2.0]])
    evidence = judge(reference, ends, np.tile(start, (len(ends), 1)), np.zeros(3))
    assert (evidence.points, evidence.hits, evidence.astray, evidence.unknown) == (5, 2, 1, 1)
    assert evidence.near == 1
    assert evidence.known == 4
    assert evidence.hit_share == 0.5


def test_a_ray_through_a_wall_speaks_against_the_pose():
    cells = np.full((60, 100), -3.0, np.float32)
    cells[:, 40] = 3.0
    reference = wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.4)
    rays = np.array([[4.0, 1.5], [2.0, 1.5]])
    starts = np.array([[0.5, 1.5], [0.5, 1.5]])
    assert judge(reference, rays, starts, np.zeros(3)).through == 1


def test_a_ray_along_a_wall_does_not_count_as_through_it():
    cells = np.full((60, 100), -3.0, np.float32)
    cells[30, :] = 3.0
    reference = wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.4)
    ray, start = np.array([[4.5, 1.58]]), np.array([[0.5, 1.45]])
    assert judge(reference, ray, start, np.zeros(3)).through == 0


def test_a_corridor_leaves_its_direction_open():
    cells = np.full((60, 400), -3.0, np.float32)
    cells[[10, 50]] = 3.0
    reference = wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.4)
    x = np.arange(-3.0, 3.0, 0.05)
    points = np.vstack([np.column_stack([x, np.full_like(x, side)]) for side in (-1.0, 1.0)])
    corridor = refine(reference, points, np.array([10.0, 1.525, 0.0]))
    room = refine(wall_map(box(), free_below=-0.4), outline(), np.zeros(3))
    assert structure(corridor) <= 0.0
    assert structure(room) > 0.2
    along, across = covariance_of(corridor, 0.0)[[0, 1], [0, 1]]
    assert along > 100.0 * across
    turned = covariance_of(corridor, np.pi / 2)
    np.testing.assert_allclose([turned[1, 1], turned[0, 0]], [along, across], rtol=1e-6)
