from __future__ import annotations

import numpy as np

from mapping.grid import OccupancyGrid
from mapping.place_evidence import judge
from tests.mapping.walled_box import CELL_M, box, faces_of, towards


def test_evidence_counts_what_points_say():
    reference = faces_of(box())
    start = np.array([2.5, 2.0])
    ends = np.array([[0.525, 2.0], [2.5, 0.525], [3.2, 2.0], [0.1, 2.0], [4.3, 2.0]])
    evidence = judge(reference, ends, towards(start, ends), np.tile(start, (len(ends), 1)), np.zeros(3))
    assert (evidence.points, evidence.hits, evidence.astray, evidence.unknown) == (5, 2, 1, 1)
    assert evidence.near == 1
    assert evidence.known == 4
    assert evidence.hit_share == 0.5


def test_a_ray_through_a_wall_speaks_against_the_pose():
    cells = np.full((60, 100), -3.0, np.float32)
    cells[:, 40] = 3.0
    reference = faces_of(OccupancyGrid(cells, CELL_M, np.zeros(3)))
    rays = np.array([[4.0, 1.5], [2.0, 1.5]])
    starts = np.array([[0.5, 1.5], [0.5, 1.5]])
    assert judge(reference, rays, np.full(2, np.pi), starts, np.zeros(3)).through == 1


def test_a_ray_along_a_wall_does_not_count_as_through_it():
    cells = np.full((60, 100), -3.0, np.float32)
    cells[30, :] = 3.0
    reference = faces_of(OccupancyGrid(cells, CELL_M, np.zeros(3)))
    ray, start = np.array([[4.5, 1.58]]), np.array([[0.5, 1.45]])
    assert judge(reference, ray, np.full(1, np.pi), start, np.zeros(3)).through == 0


def test_a_face_seen_from_the_other_side_is_not_known():
    cells = np.zeros((60, 100), np.float32)
    cells[31:] = -3.0  # free above y = 1.55 m, and the upper face of a wall below it
    cells[30] = 3.0
    faces, x = faces_of(OccupancyGrid(cells, CELL_M, np.zeros(3))), np.arange(1.0, 4.0, 0.05)
    lower = np.column_stack([x, np.full_like(x, 1.405)])
    below, above = np.tile([2.5, 0.5], (len(x), 1)), np.tile([2.5, 2.5], (len(x), 1))
    evidence = judge(faces, lower, np.full_like(x, -np.pi / 2.0), below, np.zeros(3))
    assert (evidence.hits, evidence.unknown) == (0, len(x))
    assert judge(faces, lower, np.full_like(x, np.pi / 2.0), above, np.zeros(3)).hits == len(x)
