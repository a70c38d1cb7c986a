from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mapping import se2
from mapping.joint_refinement import RefinementSettings, choose_pairs, refine_jointly
from mapping.pose_graph import Constraints

SETTINGS = RefinementSettings()


@pytest.fixture(scope="module")
def survey(building, lap_poses):
    """Every second keyframe of a lap, and the truth."""
    poses = lap_poses[::2]
    return building.keyframes(poses).snapshot(), poses


def steps_of(poses: np.ndarray, weak: int | None = None) -> Constraints:
    count = len(poses) - 1
    information = np.tile(np.diag([400.0, 400.0, 4000.0]), (count, 1, 1))
    if weak is not None:
        information[weak] = np.diag([1e-6, 1e-6, 1e-4])
    return Constraints(
        np.arange(count),
        np.arange(1, count + 1),
        se2.between(poses[:-1], poses[1:]),
        information,
        np.zeros(count, bool),
    )


def perturbed(poses: np.ndarray, sigma_m: float, sigma_rad: float) -> np.ndarray:
    noise = np.random.default_rng(6).normal(0.0, [sigma_m, sigma_m, sigma_rad], poses.shape)
    noise[0] = 0.0
    return poses + noise


def error_of(poses: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    off = se2.between(truth, poses)
    return float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())), float(np.abs(off[:, 2]).mean())


def refined(clouds, poses: np.ndarray, steps: Constraints, cancelled: Callable[[], bool] = lambda: False):
    return refine_jointly(clouds, poses, steps, SETTINGS, kernel=3.0, cancelled=cancelled)


def test_a_perturbed_trajectory_is_brought_back(survey) -> None:
    clouds, truth = survey
    poses = perturbed(truth, 0.04, 0.01)
    better = refined(clouds, poses, steps_of(poses))
    before_m, before_rad = error_of(poses, truth)
    after_m, after_rad = error_of(better, truth)
    assert after_m < 0.35 * before_m
    assert after_rad < 0.25 * before_rad
    np.testing.assert_array_equal(better[0], poses[0])
    np.testing.assert_array_equal(poses, perturbed(truth, 0.04, 0.01))  # what was given is left alone


def test_the_truth_stays_within_the_noise(survey) -> None:
    clouds, truth = survey
    error_m, error_rad = error_of(refined(clouds, truth, steps_of(truth)), truth)
    assert error_m < 0.01  # ranges have 1 cm of noise
    assert error_rad < 0.001


def test_a_cancelled_refinement_returns_nothing(survey) -> None:
    clouds, truth = survey
    asked: list[bool] = []

    def in_the_third_sweep() -> bool:
        asked.append(True)
        return len(asked) == 3

    assert refined(clouds, truth, steps_of(truth), in_the_third_sweep) is None
    assert len(asked) == 3


def test_refining_twice_gives_the_same_bits(survey) -> None:
    clouds, truth = survey
    poses = perturbed(truth[:20], 0.04, 0.01)
    np.testing.assert_array_equal(refined(clouds, poses, steps_of(poses)), refined(clouds, poses, steps_of(poses)))


def test_a_step_over_a_loss_is_not_trusted(survey) -> None:
    """The steps are held firmly, but not the one over which tracking was lost: the walls say where the rest is."""
    clouds, truth = survey
    poses = truth[:24].copy()
    poses[12:] = se2.compose(se2.compose(poses[12], [0.15, -0.1, 0.02]), se2.between(poses[12], poses[12:]))
    freed = refined(clouds, poses, steps_of(poses, weak=11))
    held = refined(clouds, poses, steps_of(poses))
    assert error_of(freed, truth[:24])[0] < 0.02
    assert error_of(freed, truth[:24])[0] < error_of(held, truth[:24])[0]


# Pairs


def test_pairs_overlap_and_include_neighbours_and_earlier_passes(survey) -> None:
    clouds, truth = survey
    first, second = choose_pairs(clouds, truth, SETTINGS)
    assert len(first) == len(second)
    assert np.all(first != second)
    assert len({*zip(first.tolist(), second.tolist(), strict=True)}) == len(first)
    apart = np.hypot(*(truth[first] - truth[second])[:, :2].T)
    assert apart.max() <= SETTINGS.reach_m
    for keyframe in range(1, len(truth) - 1):
        assert {keyframe - 1, keyframe + 1} <= set(second[first == keyframe].tolist())
    numbers = np.bincount(first)
    assert numbers.max() <= SETTINGS.partners + 2 * 3
    last = second[first == len(truth) - 1]
    assert np.count_nonzero(len(truth) - 1 - last > 40) >= 5  # the pass of a lap ago


def test_keyframes_far_from_all_others_have_no_partners(building) -> None:
    poses = np.array([[5.0, 4.8, 0.0], [15.0, 9.2, 1.0]])
    clouds = building.keyframes(poses).snapshot()
    first, second = choose_pairs(clouds, poses, SETTINGS)
    assert (len(first), len(second)) == (0, 0)
    np.testing.assert_allclose(refined(clouds, poses, steps_of(poses)), poses, atol=1e-9)


def test_of_many_near_keyframes_an_even_choice_is_compared(building) -> None:
    poses = np.column_stack([np.linspace(7.0, 9.0, 100), np.full(100, 4.8), np.zeros(100)])
    clouds = building.keyframes(poses).snapshot()
    first, _ = choose_pairs(clouds, poses, RefinementSettings(most_compared=20))
    assert np.bincount(first).min() >= 3
