from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_matching import covariance_of, refine, structure
from mapping.wall_map import FAR_M, FREE, UNKNOWN, WALL, wall_map
from tests.mapping.walled_box import CELL_M, box, faces_of, towards


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
    fit = refine(faces_of(box()), points, towards(np.zeros(2), points), se2.compose(truth, off))
    error = se2.between(truth, fit.pose)
    assert np.abs(error[:2]).max() < 0.01
    assert abs(error[2]) < 0.01
    assert fit.hits == 1.0


def test_a_corridor_leaves_its_direction_open():
    cells = np.full((60, 400), -3.0, np.float32)
    cells[[10, 50]] = 3.0
    reference = faces_of(OccupancyGrid(cells, CELL_M, np.zeros(3)))
    x = np.arange(-3.0, 3.0, 0.05)
    points = np.vstack([np.column_stack([x, np.full_like(x, side)]) for side in (-1.0, 1.0)])
    facings = np.where(points[:, 1] > 0.0, -np.pi / 2.0, np.pi / 2.0)
    corridor = refine(reference, points, facings, np.array([10.0, 1.525, 0.0]))
    room = refine(faces_of(box()), outline(), towards(np.array([2.5, 2.0]), outline()), np.zeros(3))
    assert structure(corridor) <= 0.0
    assert structure(room) > 0.2
    along, across = covariance_of(corridor, 0.0)[[0, 1], [0, 1]]
    assert along > 100.0 * across
    turned = covariance_of(corridor, np.pi / 2)
    np.testing.assert_allclose([turned[1, 1], turned[0, 0]], [along, across], rtol=1e-6)


def one_sided() -> OccupancyGrid:
    """Free space above y = 1.55 m, and the upper face of a wall below it, of which nothing else was seen."""
    cells = np.zeros((60, 100), np.float32)
    cells[31:] = -3.0
    cells[30] = 3.0
    return OccupancyGrid(cells, CELL_M, np.zeros(3))


def test_a_face_seen_from_the_other_side_does_not_pull():
    faces, x = faces_of(one_sided()), np.arange(1.0, 4.0, 0.05)
    below = np.column_stack([x, np.full_like(x, 1.405)])  # the wall's lower face, 0.12 m thick
    lower, upper = np.full_like(x, -np.pi / 2.0), np.full_like(x, np.pi / 2.0)
    np.testing.assert_array_equal(refine(faces, below, lower, np.zeros(3)).pose, 0.0)
    assert refine(faces, below, upper, np.zeros(3)).pose[1] == pytest.approx(0.12, abs=0.01)


def test_which_way_a_surface_faces_turns_with_the_pose():
    faces, x = faces_of(one_sided()), np.arange(-1.0, 1.0, 0.05)
    turned = np.array([2.5, 0.0, np.pi / 2.0])
    seen = np.column_stack([np.full_like(x, 1.5), x])
    assert refine(faces, seen, np.zeros_like(x), turned).pose[1] == pytest.approx(0.025, abs=0.01)
    np.testing.assert_array_equal(refine(faces, seen, np.full_like(x, np.pi), turned).pose, turned)
