"""Walls that were seen from one side or from both, and what a surface that faces somewhere can be."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.wall_faces import FACINGS, faces_towards, facing_layer, facing_layers, wall_faces
from mapping.wall_map import WallMap, distances_to, wall_map

CELL_M = 0.05
UP, DOWN, RIGHT = FACINGS // 4, 3 * FACINGS // 4, 0


def walls(above: float, below: float, thickness: int) -> WallMap:
    """A wall of so many cells along x, its lowest row at 30; log-odds above and below it."""
    cells = np.full((60, 100), above, np.float32)
    cells[:30] = below
    cells[30 : 30 + thickness] = 3.0
    return wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.4)


@pytest.mark.parametrize("thickness", [1, 2, 3])
def test_a_wall_seen_from_one_side_faces_that_side_only(thickness):
    faces = faces_towards(walls(-3.0, 0.0, thickness))
    middle = np.s_[30 : 30 + thickness, 20:80]
    for layer, is_seen in ((UP, True), (UP - 1, True), (UP + 1, True), (DOWN, False), (DOWN - 1, False)):
        assert (faces[layer][middle] == is_seen).all()


def test_each_side_of_a_thick_wall_faces_its_own_way():
    faces = faces_towards(walls(-3.0, -3.0, 4))
    assert faces[UP, 33, 20:80].all()
    assert not faces[UP, 30, 20:80].any()
    assert faces[DOWN, 30, 20:80].all()
    assert not faces[DOWN, 33, 20:80].any()


def test_a_wall_of_one_cell_seen_from_both_sides_may_be_any_face():
    thin = walls(-3.0, -3.0, 1)
    faces = faces_towards(thin)
    assert (faces == (thin.distances == 0.0)).all()


def test_every_wall_can_be_seen_from_somewhere_and_nothing_else_can():
    random = np.random.default_rng(3)
    cells = random.choice([-3.0, 0.0, 3.0], (80, 90), p=[0.6, 0.2, 0.2]).astype(np.float32)
    messy = wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.4)
    assert (faces_towards(messy).any(axis=0) == (messy.distances == 0.0)).all()


def test_the_distances_of_a_layer_are_those_to_its_faces():
    seen = walls(-3.0, 0.0, 2)
    layered = wall_faces(seen)
    for layer, faces in enumerate(faces_towards(seen)):
        np.testing.assert_array_equal(layered.distances[layer], distances_to(faces, CELL_M))
    assert layered.distances[UP, 40, 50] == seen.distances[40, 50]
    assert layered.distances[DOWN, 40, 50] > 0.5


def test_a_map_without_walls_has_no_faces():
    empty = wall_map(OccupancyGrid(np.full((5, 7), -3.0, np.float32), CELL_M, np.zeros(3)), free_below=-0.4)
    assert not faces_towards(empty).any()


def test_a_layer_is_the_nearest_of_its_directions_whatever_the_turns():
    angles = np.random.default_rng(0).uniform(-20.0, 20.0, 200)
    layers = facing_layers(angles)
    off = np.angle(np.exp(1j * (angles - layers * 2.0 * np.pi / FACINGS)))
    assert (np.abs(off) <= np.pi / FACINGS + 1e-9).all()
    assert layers.tolist() == [facing_layer(angle) for angle in angles.tolist()]
    assert facing_layer(0.0) == RIGHT
    assert facing_layer(np.pi / 2.0) == UP
