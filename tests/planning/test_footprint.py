"""The compiled outline test against geometry done another way."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from planning.footprint import clearance_m, free_length_m, is_free, poses_are_free
from planning.vehicle import Vehicle

CARS = {
    "rectangle": Vehicle(margin_m=0.0),
    "ship": Vehicle(((-0.1, -0.1), (0.2, -0.12), (0.35, 0.0), (0.2, 0.1), (-0.1, 0.1)), margin_m=0.0),
    "wedge": Vehicle(((-0.1, -0.2), (0.5, 0.05), (-0.2, 0.2)), margin_m=0.0),
}
CELL_M = 0.05
SHAPE = (60, 60)
SPACING_M = 0.004  # of the points that stand for a body


def distances(mask: np.ndarray) -> np.ndarray:
    if not mask.any():
        return np.full(mask.shape, 1e6, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL_M)


def body_points(body: np.ndarray) -> np.ndarray:
    """Points (M, 2) of the polygon: its fan of triangles, densely filled."""
    filled = []
    for second, third in itertools.pairwise(body[1:]):
        count = int(max(np.hypot(*(second - body[0])), np.hypot(*(third - body[0]))) / SPACING_M) + 2
        u, v = np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, count))
        keep = u + v <= 1.0 + 1e-9
        filled.append(body[0] + u[keep, np.newaxis] * (second - body[0]) + v[keep, np.newaxis] * (third - body[0]))
    return np.vstack(filled)


def sampled_clearance_m(mask: np.ndarray, pose: np.ndarray, body: np.ndarray) -> float:
    """Distance from densely sampled points of the body to the squares of blocked cells."""
    points = body_points(body)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x = pose[0] + cos * points[:, 0] - sin * points[:, 1]
    y = pose[1] + sin * points[:, 0] + cos * points[:, 1]
    best = np.inf
    for row, col in np.argwhere(mask):
        u = np.maximum(np.abs(x - (col + 0.5) * CELL_M) - CELL_M / 2, 0.0)
        v = np.maximum(np.abs(y - (row + 0.5) * CELL_M) - CELL_M / 2, 0.0)
        best = min(best, float(np.hypot(u, v).min()))
    return best


def free(mask: np.ndarray, known: np.ndarray, pose: np.ndarray, car: Vehicle) -> bool:
    x, y, yaw = np.asarray(pose, np.float64).tolist()
    return bool(is_free(mask, known, CELL_M, x, y, yaw, car.body))


def free_length(mask: np.ndarray, known: np.ndarray, pose: np.ndarray, car: Vehicle) -> float:
    x, y, yaw = np.asarray(pose, np.float64).tolist()
    return float(free_length_m(mask, known, CELL_M, x, y, yaw, car.body, car.outer_radius_m))


def scene(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A mask with a few blocked cells, and a pose among them."""
    random = np.random.default_rng(seed)
    mask = np.zeros(SHAPE, bool)
    mask[tuple(random.integers(18, 42, (2, 6)))] = True
    return mask, np.array([*random.uniform(1.2, 1.8, 2), random.uniform(-4, 4)])


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_dense_sampling(seed, car):
    mask, pose = scene(seed)
    expected = sampled_clearance_m(mask, pose, car.body)
    is_so = free(mask, distances(mask), pose, car)
    measured = clearance_m(mask, distances(mask), CELL_M, pose[np.newaxis], car.body)
    length_m = free_length(mask, distances(mask), pose, car)
    assert poses_are_free(mask, distances(mask), CELL_M, pose[np.newaxis], car.body) == (-1 if is_so else 0)
    assert is_so == (length_m >= 0.0)
    if expected > SPACING_M:
        assert is_so
        assert measured == pytest.approx(expected, abs=SPACING_M)
        assert length_m <= measured + 1e-9
        assert length_m >= min(measured, car.outer_radius_m / 2) / np.sqrt(2.0) - CELL_M / 2
    elif expected == 0.0:
        assert not is_so
        assert measured == 0.0


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
@pytest.mark.parametrize("seed", range(20))
def test_within_its_free_length_the_car_may_move_and_turn(seed, car):
    mask, pose = scene(seed)
    known = distances(mask)
    length_m = free_length(mask, known, pose, car)
    random = np.random.default_rng(seed)
    for _ in range(200):
        share, direction = random.uniform(-1, 1), random.uniform(-np.pi, np.pi)
        turn = share * length_m / car.outer_radius_m
        far = (1 - abs(share)) * length_m
        moved = pose + np.array([far * np.cos(direction), far * np.sin(direction), turn])
        if length_m > 0.0:
            assert free(mask, known, moved, car)


@pytest.mark.parametrize("cut_m", [0.6, 1.0])
def test_distances_that_are_cut_off_give_the_same_answer(cut_m):
    car = CARS["rectangle"]
    for seed in range(60):
        mask, pose = scene(seed)
        full, cut = distances(mask), np.minimum(distances(mask), np.float32(cut_m))
        pose[:2] += np.random.default_rng(seed).uniform(-0.7, 0.7, 2)
        assert free(mask, full, pose, car) == free(mask, cut, pose, car)


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
@pytest.mark.parametrize(
    "pose",
    [
        (0.05, 1.5, 0.0),
        (2.7, 1.5, 0.0),
        (1.5, 2.75, np.pi / 2),
        (-5.0, 1.0, 0.0),
        (1.5, 3.0, 0.0),
        (np.nan, 1.0, 0.0),
        (1.0, 1.0, np.nan),
    ],
)
def test_a_car_across_the_edge_of_the_map_is_not_free(pose, car):
    mask = np.zeros(SHAPE, bool)
    open_m = np.full(SHAPE, 1e6, np.float32)
    assert not free(mask, open_m, np.array(pose), car)
    assert free_length(mask, open_m, np.array(pose), car) < 0.0


def test_the_edge_of_the_map_limits_the_free_length():
    car, mask = CARS["rectangle"], np.zeros(SHAPE, bool)
    for x in np.linspace(0.1, 2.5, 30).tolist():
        length_m = free_length(mask, distances(mask), np.array([x, 1.5, 0.0]), car)
        to_edge_m = min(x - 0.0845, 3.0 - x - 0.3405, 1.5 - 0.096)
        assert length_m <= to_edge_m + 1e-9
        assert length_m >= min(to_edge_m, car.outer_radius_m / 2) - 1e-9


def test_the_first_pose_that_is_not_free_is_named():
    mask = np.zeros((60, 200), bool)
    mask[20, 150] = True
    poses = np.column_stack([np.linspace(1.0, 9.0, 801), np.full(801, 1.0), np.zeros(801)])
    first = poses_are_free(mask, distances(mask), CELL_M, poses, CARS["rectangle"].body)
    assert poses[first, 0] == pytest.approx(7.5 - 0.3405, abs=0.0101)
    assert poses_are_free(mask, distances(mask), CELL_M, np.ascontiguousarray(poses[:first]), CARS["ship"].body) == -1


def test_nothing_occupied_is_infinitely_far():
    mask = np.zeros(SHAPE, bool)
    assert clearance_m(mask, distances(mask), CELL_M, np.array([[1.5, 1.5, 0.3]]), CARS["ship"].body) == np.inf


def test_the_least_clearance_along_a_path_is_found_wherever_it_is():
    mask = np.zeros((60, 200), bool)
    mask[25, 150] = True
    poses = np.column_stack([np.linspace(1.0, 9.0, 300), np.full(300, 1.0), np.zeros(300)])
    measured = clearance_m(mask, distances(mask), CELL_M, poses, CARS["rectangle"].body)
    assert measured == pytest.approx(1.25 - 1.0 - 0.096, abs=1e-6)
