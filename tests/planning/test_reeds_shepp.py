"""The words of least cost against OMPL's distance, and against words that were driven."""

from __future__ import annotations

import itertools

import numpy as np
import ompl.base as ob
import pytest

from mapping import se2
from planning import reeds_shepp

Pose = tuple[float, float, float]
Pair = tuple[float, float, float, float, float, float]
RADIUS_M = 0.443
# Turns and gears of the nine kinds of words; mirrored, flipped and driven from the end they are all 48.
KINDS = [
    ((1, 0, 1), (1, 1, 1)),
    ((1, 0, -1), (1, 1, 1)),
    ((1, -1, 1), (1, -1, 1)),
    ((1, -1, 1), (1, -1, -1)),
    ((1, -1, 1, -1), (1, 1, -1, -1)),
    ((1, -1, 1, -1), (1, -1, -1, 1)),
    ((1, -1, 0, 1), (1, -1, -1, -1)),
    ((1, -1, 0, -1), (1, -1, -1, -1)),
    ((1, -1, 0, 1, -1), (1, -1, -1, -1, 1)),
]


def random_pairs(scale_m: float, count: int) -> list[Pair]:
    pairs = np.random.default_rng(3).uniform(-1.0, 1.0, (count, 6)) * np.array([scale_m, scale_m, np.pi] * 2)
    pairs[::10, 5] = pairs[::10, 2]  # parallel, where words tie
    pairs[1::10, 5] = se2.wrap_angle(pairs[1::10, 2] + np.pi)
    return [(a, b, c, d, e, f) for a, b, c, d, e, f in pairs.tolist()]


def driven(start: Pose, lengths: np.ndarray, turns: np.ndarray) -> Pose:
    pose = start
    for length_m, turn in zip(lengths.tolist(), turns.tolist(), strict=True):
        pose = reeds_shepp.drive(*pose, length_m, turn, RADIUS_M)
    return pose


def cost_of(lengths: np.ndarray, reverse_cost: float, cusp_cost_m: float) -> float:
    there = lengths[np.abs(lengths) > 1e-9]
    weights = np.where(there > 0.0, 1.0, reverse_cost)
    return float(np.abs(there) @ weights + cusp_cost_m * np.count_nonzero(np.diff(np.sign(there))))


def random_words(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return words of all kinds as lengths and turns, their middle arcs coupled as the kind has it."""
    random, words = np.random.default_rng(5), []
    for _, (turns, gears), mirror, flip, backwards in itertools.product(
        range(count), KINDS, (1, -1), (1, -1), (False, True)
    ):
        lengths = random.uniform(0.0, np.pi, len(turns))
        if 0 in turns:
            lengths[turns.index(0)] = random.uniform(0.0, 8.0)
            if len(turns) > 3:
                lengths[[i for i in range(1, len(turns) - 1) if turns[i]]] = np.pi / 2
        elif len(turns) == 4:
            lengths[1] = lengths[2] = random.uniform(0.0, np.pi / 2)
        order = -1 if backwards else 1
        words.append(((lengths * gears * flip * RADIUS_M)[::order], (np.array(turns) * mirror)[::order]))
    return words


@pytest.mark.parametrize("scale_m", [0.2, 1.0, 4.0, 40.0])
def test_without_extra_costs_it_is_the_distance_of_ompl(scale_m):
    space = ob.ReedsSheppStateSpace(RADIUS_M)
    space.setBounds(_wide())
    information = ob.SpaceInformation(space)
    first, second = information.allocState(), information.allocState()
    for pair in random_pairs(scale_m, 1000):
        for state, (x, y, yaw) in ((first, pair[:3]), (second, pair[3:])):
            state.setX(x)
            state.setY(y)
            state.setYaw(yaw)
        lengths, _, cost = reeds_shepp.shortest(*pair, RADIUS_M, 1.0, 0.0)
        assert cost == pytest.approx(space.distance(first, second), abs=1e-9)
        assert np.abs(lengths).sum() == pytest.approx(cost, abs=1e-9)


def _wide() -> ob.RealVectorBounds:
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-100.0)
    bounds.setHigh(100.0)
    return bounds


@pytest.mark.parametrize(("reverse_cost", "cusp_cost_m"), [(1.0, 0.0), (1.5, 0.3), (4.0, 0.0), (1.0, 2.0)])
@pytest.mark.parametrize("scale_m", [0.2, 1.0, 4.0])
def test_a_word_ends_at_the_goal_and_costs_what_it_says(scale_m, reverse_cost, cusp_cost_m):
    lengths, turns = np.empty(5), np.empty(5, np.int64)
    for pair in random_pairs(scale_m, 500):
        cost = reeds_shepp.shortest_into(*pair, RADIUS_M, reverse_cost, cusp_cost_m, lengths, turns)
        error = np.subtract(driven(pair[:3], lengths, turns), pair[3:])
        error[2] = se2.wrap_angle(error[2])
        assert np.abs(error).max() < 1e-9
        assert cost == pytest.approx(cost_of(lengths, reverse_cost, cusp_cost_m), abs=1e-8)
        assert cost == reeds_shepp.shortest(*pair, RADIUS_M, reverse_cost, cusp_cost_m)[2]


@pytest.mark.parametrize(("reverse_cost", "cusp_cost_m"), [(1.0, 0.0), (1.5, 0.3), (4.0, 0.0), (1.0, 2.0), (0.5, 0.1)])
def test_nothing_that_can_be_driven_costs_less(reverse_cost, cusp_cost_m):
    start = (0.3, -0.2, 1.1)
    for lengths, turns in random_words(30):
        goal = driven(start, lengths, turns)
        cost = reeds_shepp.shortest(*start, *goal, RADIUS_M, reverse_cost, cusp_cost_m)[2]
        assert cost <= cost_of(lengths, reverse_cost, cusp_cost_m) + 1e-7


@pytest.mark.parametrize("cusp_cost_m", [0.0, 0.3])
def test_costs_choose_another_word_than_the_shortest(cusp_cost_m):
    behind = (0.0, 0.0, 0.0, -3.0, 0.0, 0.0)
    lengths, _, cost = reeds_shepp.shortest(*behind, RADIUS_M, 1.0, cusp_cost_m)
    assert (lengths.sum(), cost) == pytest.approx((-3.0, 3.0))
    lengths, _, cost = reeds_shepp.shortest(*behind, RADIUS_M, 100.0, cusp_cost_m)
    assert cost < 300.0
    assert lengths.max() > 0.0


def test_no_way_to_go_is_a_word_without_pieces():
    lengths, _, cost = reeds_shepp.shortest(1.0, 2.0, 3.0, 1.0, 2.0, 3.0 + 2.0 * np.pi, RADIUS_M, 1.5, 0.3)
    np.testing.assert_allclose(lengths, 0.0, atol=1e-12)
    assert cost == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("step_m", [0.01, 0.1, 5.0])
def test_samples_are_dense_rolling_and_exact_at_the_ends(step_m):
    for pair in random_pairs(1.0, 100):
        lengths, turns, _ = reeds_shepp.shortest(*pair, RADIUS_M, 1.0, 0.0)
        out, gears = np.full((2000, 3), np.nan), np.zeros(2000, np.int8)
        count = reeds_shepp.sample(*pair[:3], lengths, turns, RADIUS_M, step_m, out, gears)
        assert count == reeds_shepp.sample_count(lengths, step_m)
        poses, gears = out[:count], gears[:count]
        np.testing.assert_array_equal(poses[0], pair[:3])
        np.testing.assert_allclose(poses[-1, :2], pair[3:5], atol=1e-9)
        assert se2.wrap_angle(poses[-1, 2] - pair[5]) == pytest.approx(0.0, abs=1e-9)
        steps = np.diff(poses, axis=0)
        assert np.hypot(steps[:, 0], steps[:, 1]).max() <= step_m + 1e-12
        assert np.abs(steps[:, 2]).max() <= step_m / RADIUS_M + 1e-12
        # A chord points along the middle of its arc: rolling, never sliding, in the gear that is said.
        middle = poses[:-1, 2] + steps[:, 2] / 2.0
        sideways = steps[:, 1] * np.cos(middle) - steps[:, 0] * np.sin(middle)
        assert np.abs(sideways).max() < 1e-12
        half = np.abs(steps[:, 2]) / 2.0
        along = (steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)) * gears[:-1]
        moved = along * np.where(half > 1e-9, half / np.maximum(np.sin(half), 1e-12), 1.0)
        assert moved.sum() == pytest.approx(np.abs(lengths).sum(), abs=1e-9)


def test_samples_ask_for_room():
    lengths, turns, _ = reeds_shepp.shortest(0.0, 0.0, 0.0, 1.0, 0.0, 0.0, RADIUS_M, 1.0, 0.0)
    with pytest.raises(ValueError, match="room"):
        reeds_shepp.sample(0.0, 0.0, 0.0, lengths, turns, RADIUS_M, 0.01, np.empty((100, 3)), np.empty(100, np.int8))
