"""Edges checked with steps as long as the room allows, against every centimetre."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from planning import dubins, edges, reeds_shepp
from planning.footprint import poses_are_free
from planning.vehicle import Vehicle

CELL_M = 0.05
CARS = [
    Vehicle(turning_radius_m=0.443),
    Vehicle(turning_radius_m=0.3, footprint=((-0.1, -0.15), (0.5, 0.0), (-0.1, 0.15))),
]


def cluttered(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """10 m x 8 m with blocks and single cells strewn over it: the mask and its distances in m."""
    random = np.random.default_rng(seed)
    mask = np.zeros((160, 200), bool)
    mask[tuple(random.integers(0, [[160], [200]], (2, 40)))] = True
    for row, col in random.integers(0, [150, 190], (8, 2)):
        mask[row : row + 10, col : col + 8] = True
    distances = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M
    return mask, np.asarray(distances, np.float32)


def random_ends(seed: int, count: int, reach_m: float) -> list[tuple[float, float, float, float, float, float]]:
    random = np.random.default_rng(seed)
    starts = random.uniform([0.0, 0.0, -np.pi], [10.0, 8.0, np.pi], (count, 3))
    goals = starts + random.uniform(-1.0, 1.0, (count, 3)) * [reach_m, reach_m, np.pi]
    return [(a, b, c, d, e, f) for a, b, c, d, e, f in np.hstack([starts, goals]).tolist()]


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("kind", [edges.REEDS_SHEPP, edges.DUBINS])
@pytest.mark.parametrize(("seed", "reach_m"), [(1, 0.5), (2, 3.0), (3, 8.0)])
def test_agrees_with_every_millimetre(car, kind, seed, reach_m):
    mask, distance_m = cluttered(seed)
    lengths, turns = np.empty(5), np.empty(5, np.int64)
    radius, corners = car.turning_radius_m, car.corners
    out, gears = np.empty((50000, 3)), np.empty(50000, np.int8)
    free = 0
    for ends in random_ends(seed, 1500, reach_m):
        edges.steer(kind, *ends, radius, 1.5, 0.3, lengths, turns)
        x, y, yaw = ends[:3]
        count = reeds_shepp.sample(x, y, yaw, lengths, turns, radius, 0.001, out, gears)
        expected = poses_are_free(mask, distance_m, CELL_M, out[:count], corners) < 0
        where = (mask, distance_m, CELL_M, corners, car.outer_radius_m)
        assert edges.edge_is_free(*where, lengths, turns, x, y, yaw, radius, 0.01) is expected
        assert edges.way_is_free(*where, kind, *ends, radius, 1.5, 0.3) is expected
        free += expected
    assert 20 < free < 1400  # both answers were asked for


def test_a_thin_wall_across_a_long_edge_is_never_stepped_over():
    mask = np.zeros((100, 400), bool)
    mask[50, 300] = True
    distance_m = np.asarray(
        cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M, np.float32
    )
    car = CARS[0]
    where = (mask, distance_m, CELL_M, car.corners, car.outer_radius_m)
    for y, expected in ((2.525, False), (2.525 + 0.13, False), (2.525 + 0.14, True)):
        ends = (1.0, y, 0.0, 19.0, y, 0.0)
        assert edges.way_is_free(*where, edges.REEDS_SHEPP, *ends, 0.443, 1.0, 0.0) is expected


def test_steering_takes_the_words_of_its_kind():
    lengths, turns = np.empty(5), np.empty(5, np.int64)
    for ends in random_ends(4, 100, 2.0):
        cost = edges.steer(edges.REEDS_SHEPP, *ends, 0.5, 1.5, 0.3, lengths, turns)
        assert cost == reeds_shepp.shortest(*ends, 0.5, 1.5, 0.3)[2]
        assert (
            edges.steer(edges.DUBINS, *ends, 0.5, 1.5, 0.3, lengths, turns) == dubins.shortest(*ends, 0.5, 1.5, 0.3)[2]
        )
        assert lengths.min() >= 0.0


@pytest.mark.parametrize("length_m", [1e-10, 1e-22, 5e-324])
def test_a_piece_of_next_to_no_length_is_checked_and_that_ends(length_m):
    blocked, far_m = np.zeros((60, 60), bool), np.full((60, 60), 0.8, np.float32)
    lengths, turns = np.array([length_m, 0.0, 0.0, 0.0, 0.0]), np.array([1, 0, 0, 0, 0])
    car = Vehicle()
    arguments = (blocked, far_m, 0.05, car.corners, car.outer_radius_m, lengths, turns, 1.5, 1.5, 0.0, 0.576, 0.01)
    assert edges.edge_is_free(*arguments)
