from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping import se2
from mapping.keyframes import Clouds, KeyframeStore
from mapping.scan_pairs import agreement, agreement_of_pairs, nearest_sample, pull, pull_pairs
from mapping.surface import surface_of

PLAIN = 1e9  # a scale of the robust weight at which all weights are 1


def clouds_of(sensor: np.ndarray, *scans: np.ndarray) -> Clouds:
    store = KeyframeStore(sensor)
    for points in scans:
        store.add(surface_of(points, sensor))
    return store.snapshot()


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 40),
    limit=st.floats(0.01, 20.0),
    spread=st.sampled_from([0.3, 1.0, 6.3]),
)
def test_nearest_sample_equals_brute_force(seed: int, count: int, limit: float, spread: float) -> None:
    generator = np.random.default_rng(seed)
    sensor = generator.uniform(-0.5, 0.5, 2)
    bearings = generator.uniform(0.0, 2.0 * np.pi) + generator.uniform(0.0, spread, count)
    ranges = generator.uniform(0.1, 5.0, count)
    scan = sensor + ranges[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
    clouds = clouds_of(sensor, np.ones((3, 2)), scan, np.zeros((2, 2)))  # what stands before and behind is left alone
    first, last = clouds.starts[1:3]
    for x, y in [*generator.uniform(-6.0, 6.0, (20, 2)), sensor]:
        index, distance = nearest_sample(clouds.points, clouds.angles, first, last, x, y, sensor, limit)
        distances = np.hypot(*(clouds.points_of(1) - [x, y]).T)
        if count and distances.min() < limit * (1.0 - 1e-6):
            assert first <= index < last
            assert distance == pytest.approx(distances.min(), abs=1e-6)
            assert distances[index - first] == pytest.approx(distance, abs=1e-12)
        elif not count or distances.min() > limit:
            assert (index, distance) == (-1, pytest.approx(limit))


@pytest.fixture(scope="module")
def two_views(room, site) -> tuple[Clouds, np.ndarray, np.ndarray]:
    """Two looks into the room, and the poses from which they were taken, but for a few centimetres and degrees."""
    place = site(room)
    moving, fixed = np.array([3.2, 2.1, 0.7]), np.array([2.9, 2.3, -0.4])
    clouds = clouds_of(np.zeros(2), place.look(moving, 1), place.look(fixed, 2))
    return clouds, np.add(moving, [0.05, -0.03, 0.02]), np.add(fixed, [-0.02, 0.04, -0.01])


def pull_of(clouds: Clouds, moving_pose, fixed_pose, scale: float, samples: tuple[int, int] | None = None):
    """What the first keyframe's samples, or a range of them, say of both poses."""
    own_first, own_last = samples or (clouds.starts[0], clouds.starts[1])
    hessian, gradient = np.zeros((6, 6)), np.zeros(6)
    pairs, cost = pull(
        clouds.points, clouds.normals, clouds.reaches, own_first, own_last,
        clouds.points, clouds.angles, clouds.normals, clouds.levels, clouds.reaches, clouds.starts[1], clouds.starts[2],
        clouds.sensor, moving_pose, fixed_pose, 0.3, scale, 1, hessian, gradient,
    )  # fmt: skip
    return pairs, cost, hessian + np.triu(hessian, 1).T, gradient


def residual(clouds: Clouds, moving_pose, fixed_pose, sample: int) -> float:
    """The distance of one sample of the first keyframe from its wall in the second."""
    place = se2.transform_points(se2.between(fixed_pose, moving_pose), clouds.points[sample].astype(np.float64))
    first, last = clouds.starts[1], clouds.starts[2]
    near, _ = nearest_sample(clouds.points, clouds.angles, first, last, place[0], place[1], clouds.sensor, 0.4)
    return float(clouds.normals[near].astype(np.float64) @ place - clouds.levels[near])


@pytest.mark.parametrize("scale", [PLAIN, 0.05])
def test_gradient_and_hessian_equal_numeric_differentiation(scale: float, two_views) -> None:
    clouds, moving, fixed = two_views

    def error(poses: np.ndarray, sample: int) -> float:
        return residual(clouds, poses[:3], poses[3:], sample)

    compared = 0
    for sample in range(0, int(clouds.starts[1]), 3):
        pairs, cost, hessian, gradient = pull_of(clouds, moving, fixed, scale, (sample, sample + 1))
        if not pairs:
            continue
        poses, step = np.concatenate([moving, fixed]), 1e-6
        here = error(poses, sample)
        slope = np.array(
            [
                (error(poses + step * unit, sample) - error(poses - step * unit, sample)) / (2.0 * step)
                for unit in np.eye(6)
            ]
        )
        if np.abs(slope).max() > 20.0:
            continue  # another sample is nearest a micrometre away
        # Geman-McClure: rho(e) = e^2 / 2 / (1 + (e / scale)^2), whose slope is weight x e.
        weight = (1.0 + (here / scale) ** 2) ** -2.0
        np.testing.assert_allclose(gradient, weight * here * slope, atol=1e-6)
        np.testing.assert_allclose(hessian, weight * np.outer(slope, slope), atol=1e-5)
        assert cost == pytest.approx(weight * here**2, abs=1e-9)
        compared += 1
    assert compared > 60


def test_a_pull_is_the_sum_over_its_samples(two_views) -> None:
    clouds, moving, fixed = two_views
    pairs, cost, hessian, gradient = pull_of(clouds, moving, fixed, 0.1)
    single = [pull_of(clouds, moving, fixed, 0.1, (sample, sample + 1)) for sample in range(clouds.starts[1])]
    assert pairs == sum(each[0] for each in single)
    assert pairs > 200
    assert cost == pytest.approx(sum(each[1] for each in single))
    np.testing.assert_allclose(hessian, sum(each[2] for each in single), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(gradient, sum(each[3] for each in single), rtol=1e-9, atol=1e-9)


def test_moving_both_poses_together_changes_nothing(two_views) -> None:
    clouds, moving, fixed = two_views
    elsewhere = np.array([30.0, -12.0, 2.5])
    here = pull_of(clouds, moving, fixed, 0.1)
    there = pull_of(clouds, se2.compose(elsewhere, moving), se2.compose(elsewhere, fixed), 0.1)
    assert here[0] == there[0]
    assert here[1] == pytest.approx(there[1])
    # The direction in which both poses move as one is free: translations have opposite gradients.
    np.testing.assert_allclose(there[3][:2], -there[3][3:5], atol=1e-9)


def test_pairs_are_pulled_one_by_one(two_views) -> None:
    clouds, moving, fixed = two_views
    hessians, gradients, numbers, costs = pull_pairs(
        clouds.points, clouds.angles, clouds.normals, clouds.levels, clouds.reaches, clouds.starts, clouds.sensor,
        np.array([0, 1]), np.array([1, 0]), np.array([moving, fixed]), np.array([fixed, moving]), 0.3, 0.1, 1,
    )  # fmt: skip
    pairs, cost, hessian, gradient = pull_of(clouds, moving, fixed, 0.1)
    assert (numbers[0], costs[0]) == (pairs, cost)
    np.testing.assert_array_equal(gradients[0], gradient)
    np.testing.assert_array_equal(hessians, hessians.transpose(0, 2, 1))
    np.testing.assert_allclose(hessians[0], hessian)
    assert numbers[1] > 0


def test_the_two_sides_of_a_thin_wall_are_two_walls() -> None:
    along = np.column_stack([np.linspace(-1.0, 1.0, 81), np.zeros(81)])
    clouds = clouds_of(np.zeros(2), np.add(along, [0.0, 1.0]), np.add(along, [0.0, -1.0]))
    other_side = np.array([0.0, -2.05, 0.0])  # the first looks at the wall from below, the second from above
    assert pull_of(clouds, other_side, np.zeros(3), 0.1)[0] == 0
    same_side = np.array([0.0, 0.05, np.pi])
    assert pull_of(clouds, same_side, np.zeros(3), 0.1)[0] > 60


# Agreement


def counts(clouds: Clouds, moving: int, fixed: int, T_fixed_moving, stride: int = 1) -> tuple[int, int, int]:
    return agreement(
        clouds.points, clouds.angles, clouds.ranges, clouds.starts, clouds.sensor, moving, fixed,
        np.asarray(T_fixed_moving, dtype=np.float64), 0.1, stride,
    )  # fmt: skip


def test_a_scan_agrees_with_itself_and_with_one_from_nearby(two_views) -> None:
    clouds, _, _ = two_views
    total = int(clouds.starts[1])
    assert counts(clouds, 0, 0, np.zeros(3)) == (total, 0, 0)
    hits, conflicts, hidden = counts(clouds, 0, 1, se2.between([2.9, 2.3, -0.4], [3.2, 2.1, 0.7]))
    assert hits + conflicts + hidden == total
    assert hits > 0.85 * total
    assert conflicts < 0.03 * total


def test_what_stands_before_a_seen_wall_is_a_conflict_and_behind_it_hidden() -> None:
    across = np.linspace(-0.5, 0.5, 101)
    wall = np.column_stack([np.full(101, 3.0), 3.0 * across])
    inner = wall[20:-20]
    clouds = clouds_of(np.zeros(2), wall, inner)
    assert counts(clouds, 1, 0, [-1.0, 0.0, 0.0]) == (0, 61, 0)
    assert counts(clouds, 1, 0, [+1.0, 0.0, 0.0]) == (0, 0, 61)
    assert counts(clouds, 1, 0, [0.05, 0.0, 0.0]) == (61, 0, 0)
    assert counts(clouds, 1, 0, [0.0, 0.0, np.pi]) == (0, 0, 61)  # no ray went there


def test_agreement_sums_over_pairs_and_uses_every_stride_th_sample(two_views) -> None:
    clouds, _, _ = two_views
    T_1_0 = se2.between([2.9, 2.3, -0.4], [3.2, 2.1, 0.7])
    arguments = (clouds.points, clouds.angles, clouds.ranges, clouds.starts, clouds.sensor)
    poses = np.array([T_1_0, np.zeros(3)])
    total = agreement_of_pairs(*arguments, np.array([0, 1]), np.array([1, 1]), poses, 0.1, 1)
    assert tuple(total) == tuple(np.add(counts(clouds, 0, 1, T_1_0), counts(clouds, 1, 1, np.zeros(3))))
    assert sum(counts(clouds, 0, 1, T_1_0, stride=4)) == -(-int(clouds.starts[1]) // 4)


def test_empty_scans_say_nothing() -> None:
    clouds = clouds_of(np.zeros(2), np.zeros((0, 2)), np.array([[1.0, 0.0], [1.0, 0.1], [1.0, 0.2]]))
    assert counts(clouds, 0, 1, np.zeros(3)) == (0, 0, 0)
    assert counts(clouds, 1, 0, np.zeros(3)) == (0, 0, 0)
    assert pull_of(clouds, np.zeros(3), np.zeros(3), 0.1)[:2] == (0, 0.0)
