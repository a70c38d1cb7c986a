from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.pose_graph import (
    Constraints,
    NormalEquations,
    chi_squared,
    linearise,
    optimise,
    residuals,
    robust_weights,
    shortest_ways,
)

STEP_INFORMATION = np.diag([0.02**-2.0, 0.02**-2.0, 0.005**-2.0])
LOOP_INFORMATION = np.diag([0.03**-2.0, 0.03**-2.0, 0.01**-2.0])


def constraints(first, second, measured, information, robust: bool) -> Constraints:
    count = len(first)
    return Constraints(
        np.asarray(first, dtype=np.int64),
        np.asarray(second, dtype=np.int64),
        np.asarray(measured, dtype=np.float64),
        np.broadcast_to(information, (count, 3, 3)).copy(),
        np.full(count, robust),
    )


def measured_between(poses, first, second, information, *, robust: bool) -> Constraints:
    return constraints(first, second, se2.between(poses[first], poses[second]), information, robust)


@pytest.fixture(scope="module")
def two_rounds() -> np.ndarray:
    """120 poses (120, 3) of two rounds on a circle of 5 m radius, which begin at the origin."""
    return se2.compose(np.zeros((120, 3)), se2.exp(np.arange(120)[:, None] * np.array([0.5236, 0.0, 0.10472])))


@pytest.fixture(scope="module")
def drifted(two_rounds) -> tuple[np.ndarray, Constraints]:
    """The same as odometry saw it, and its steps: up to metres off."""
    steps = se2.between(two_rounds[:-1], two_rounds[1:])
    steps = steps + np.random.default_rng(3).normal(0.0, [0.02, 0.02, 0.005], steps.shape) + [0.0, 0.0, 0.002]
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses), constraints(np.arange(119), np.arange(1, 120), steps, STEP_INFORMATION, robust=False)


def off_m(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.hypot(*(poses - truth)[:, :2].T).max())


def test_linearised_residuals_equal_numeric_derivatives() -> None:
    generator = np.random.default_rng(5)
    poses = generator.uniform(-3.0, 3.0, (4, 3))
    root = generator.normal(size=(3, 3, 3))
    measured = constraints([0, 1, 3], [2, 3, 0], generator.uniform(-3.0, 3.0, (3, 3)), np.eye(3), robust=False)
    measured = Constraints(
        measured.first, measured.second, measured.T_first_second, root @ root.transpose(0, 2, 1), measured.robust
    )
    weights = np.array([1.0, 0.3, 0.7])
    hessians, gradients = linearise(poses, measured, weights)
    step = 1e-6
    for edge, (first, second) in enumerate(zip(measured.first, measured.second, strict=True)):
        jacobian = np.empty((3, 6))
        for axis in range(6):
            moved = np.zeros_like(poses)
            moved[first if axis < 3 else second, axis % 3] = step
            ahead, behind = residuals(poses + moved, measured)[edge], residuals(poses - moved, measured)[edge]
            jacobian[:, axis] = (ahead - behind) / (2.0 * step)
        weighted = weights[edge] * measured.information[edge]
        np.testing.assert_allclose(hessians[edge], jacobian.T @ weighted @ jacobian, atol=1e-6)
        np.testing.assert_allclose(gradients[edge], jacobian.T @ weighted @ residuals(poses, measured)[edge], atol=1e-6)


def test_residuals_vanish_at_the_truth_and_chi_squared_counts_deviations(two_rounds) -> None:
    measured = measured_between(two_rounds, np.arange(60), np.arange(60) + 60, LOOP_INFORMATION, robust=True)
    np.testing.assert_allclose(residuals(two_rounds, measured), 0.0, atol=1e-9)
    one_sigma = constraints([0], [1], [[0.03, 0.0, 0.0]], LOOP_INFORMATION, robust=True)
    assert chi_squared(np.zeros((2, 3)), one_sigma) == pytest.approx([1.0])
    assert robust_weights(np.zeros((2, 3)), one_sigma, 2.0) == pytest.approx([0.8])


def test_sparse_equations_solve_as_dense_ones() -> None:
    generator = np.random.default_rng(8)
    equations, dense, right = NormalEquations(5, fixed=2), np.zeros((15, 15)), np.zeros(15)
    for first, second in ((np.array([0, 1]), np.array([1, 2])), (np.array([2, 3, 0]), np.array([3, 4, 4]))):
        root = generator.normal(size=(len(first), 6, 6))
        hessians, gradients = root @ root.transpose(0, 2, 1), generator.normal(size=(len(first), 6))
        equations.add(first, second, hessians, gradients)
        for edge in range(len(first)):
            places = np.concatenate([3 * first[edge] + np.arange(3), 3 * second[edge] + np.arange(3)])
            dense[np.ix_(places, places)] += hessians[edge]
            right[places] += gradients[edge]
    free = np.delete(np.arange(15), [6, 7, 8])
    damped = dense[np.ix_(free, free)] + 0.1 * np.diag(np.diag(dense)[free])
    step = equations.solve(0.1)
    np.testing.assert_allclose(step.ravel()[free], -np.linalg.solve(damped, right[free]), rtol=1e-6)
    assert not step[2].any()


@pytest.mark.parametrize("fixed", [0, 50])
def test_a_known_graph_is_recovered_from_a_bad_guess(fixed: int, two_rounds) -> None:
    guess = two_rounds + np.random.default_rng(1).normal(0.0, [0.3, 0.3, 0.2], two_rounds.shape)
    guess[fixed] = two_rounds[fixed]
    exact = measured_between(two_rounds, np.arange(119), np.arange(1, 120), STEP_INFORMATION, robust=False)
    loops = measured_between(two_rounds, np.arange(0, 60, 5), np.arange(60, 120, 5), LOOP_INFORMATION, robust=False)
    solution = optimise(guess, exact.joined(loops), fixed=fixed)
    np.testing.assert_allclose(solution.poses[:, :2], two_rounds[:, :2], atol=1e-3)
    np.testing.assert_allclose(se2.wrap_angle(solution.poses[:, 2] - two_rounds[:, 2]), 0.0, atol=1e-3)
    np.testing.assert_array_equal(solution.poses[fixed], two_rounds[fixed])
    assert solution.chi2.max() < 1.0


def test_loops_take_the_drift_away(drifted, two_rounds) -> None:
    poses, steps = drifted
    assert off_m(poses, two_rounds) > 0.5
    loops = measured_between(two_rounds, np.arange(0, 60, 5), np.arange(60, 120, 5), LOOP_INFORMATION, robust=True)
    both = steps.joined(loops)
    closed = optimise(optimise(poses, both, kernel=20.0).poses, both, kernel=3.0).poses
    apart = se2.between(closed[:60], closed[60:])
    assert np.hypot(apart[:, 0], apart[:, 1]).max() < 0.15  # both rounds lie on each other again
    assert off_m(closed, two_rounds) < 0.6 * off_m(poses, two_rounds)


def test_without_loops_nothing_moves(drifted) -> None:
    poses, steps = drifted
    np.testing.assert_allclose(optimise(poses, steps).poses, poses, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_random_wrong_closures_do_not_bend_the_map(seed: int, drifted, two_rounds) -> None:
    poses, steps = drifted
    generator = np.random.default_rng(seed)
    right = measured_between(two_rounds, np.arange(0, 60, 5), np.arange(60, 120, 5), LOOP_INFORMATION, robust=True)
    wrong = constraints(
        generator.integers(0, 50, 8), generator.integers(60, 120, 8),
        generator.uniform([-4, -4, -3], [4, 4, 3], (8, 3)), LOOP_INFORMATION, robust=True,
    )  # fmt: skip
    without = optimise(optimise(poses, steps.joined(right), kernel=20.0).poses, steps.joined(right), kernel=3.0)
    both = steps.joined(right).joined(wrong)
    bent = optimise(optimise(poses, both, kernel=20.0).poses, both, kernel=3.0)
    assert off_m(bent.poses, without.poses) < 0.1
    assert bent.chi2[-8:].min() > 100.0  # what may be withdrawn
    assert bent.chi2[-20:-8].max() < 100.0


def test_ten_wrong_closures_that_agree_do_not_bend_the_map(drifted, two_rounds) -> None:
    """A look-alike place 3 m off: every closure of the pass states the same wrong shift."""
    poses, steps = drifted
    right = measured_between(two_rounds, np.arange(0, 60, 5), np.arange(60, 120, 5), LOOP_INFORMATION, robust=True)
    shifted = se2.compose([3.0, 1.0, 0.3], two_rounds)
    first, second = np.arange(20, 30), np.arange(80, 90)
    wrong = constraints(first, second, se2.between(two_rounds[first], shifted[second]), LOOP_INFORMATION, robust=True)
    without = optimise(optimise(poses, steps.joined(right), kernel=20.0).poses, steps.joined(right), kernel=3.0)
    both = steps.joined(right).joined(wrong)
    bent = optimise(optimise(poses, both, kernel=20.0).poses, both, kernel=3.0)
    assert off_m(bent.poses, without.poses) < 0.15
    assert bent.chi2[-10:].min() > 100.0


def test_the_cost_never_rises_with_more_iterations(drifted, two_rounds) -> None:
    poses, steps = drifted
    loops = measured_between(two_rounds, np.arange(0, 60, 5), np.arange(60, 120, 5), LOOP_INFORMATION, robust=False)
    both = steps.joined(loops)
    costs = [optimise(poses, both, iterations=number).chi2.sum() for number in range(5)]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < 0.1 * costs[0]


def test_the_shortest_way_takes_closures_and_knows_where_none_leads() -> None:
    first, second = np.array([0, 1, 2, 4, 0]), np.array([1, 2, 3, 5, 3])
    ways = shortest_ways(6, first, second, np.array([1.0, 1.0, 1.0, 1.0, 0.0]), 3)
    np.testing.assert_allclose(ways, [0.0, 1.0, 1.0, 0.0, np.inf, np.inf], atol=1e-6)
