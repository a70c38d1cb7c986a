"""Which links go together, by small cases whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.consistency import ConsistencyRule, Link, lever, roots, without_doubt
from mapping import se2

RULE = ConsistencyRule()


def link(a: int, b: int, weight: float, x: float = 1.0) -> Link:
    """Maps stand in a row, a metre apart, unless x says otherwise."""
    return Link(a, b, np.array([x * (b - a), 0.0, 0.0]), np.diag([0.05, 0.05, 0.01]) ** 2, weight)


def chosen(count: int, links: list[Link]) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """The links that are kept without doubt, and those in doubt."""
    choice, doubtful = without_doubt(count, links, RULE)
    named = [(each.a, each.b) for each in links]
    return {named[n] for n in choice.kept if n not in doubtful}, {named[n] for n in doubtful}


def test_links_that_agree_are_all_kept():
    links = [link(0, 1, 5.0), link(1, 2, 4.0), link(0, 2, 3.0), link(2, 3, 1.0)]
    assert chosen(4, links) == ({(0, 1), (1, 2), (0, 2), (2, 3)}, set())


def test_a_bridge_needs_no_second_witness_and_is_never_in_doubt():
    links = [link(0, 1, 6.0), link(1, 2, 6.0), link(0, 2, 1.0, x=4.0), link(2, 3, 2.9)]
    kept, doubtful = chosen(4, links)
    assert kept == {(0, 1), (1, 2), (2, 3)}
    assert not doubtful


def test_a_strong_wrong_link_loses_against_many_weak_ones_that_agree():
    wrong = link(0, 1, 7.0, x=5.0)
    pairs = [(0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
    right = [link(a, b, 3.2) for a, b in pairs]
    assert chosen(4, [wrong, *right]) == (set(pairs), set())
    # Where that is not clear, the map that they argue about stays apart.
    unsure = [link(a, b, 3.0) for a, b in pairs]
    assert chosen(4, [wrong, *unsure]) == ({(0, 2), (0, 3), (2, 3)}, {(1, 2), (1, 3)})


def test_of_links_that_are_equally_sure_none_is_believed():
    links = [link(0, 1, 3.2), link(1, 2, 3.1), link(0, 2, 3.0, x=4.0)]
    kept, doubtful = chosen(3, links)
    assert kept == set()
    assert doubtful == {(0, 1), (1, 2)}


def test_errors_add_up_along_a_way():
    """One link against a way of many: what contradicts a single step is within what ten steps may drift."""
    steps = [link(number, number + 1, 5.0) for number in range(10)]
    assert (0, 10) in chosen(11, [*steps, link(0, 10, 3.0, x=1.05)])[0]
    assert (0, 10) not in chosen(11, [*steps, link(0, 10, 3.0, x=1.5)])[0]


def test_the_lever_is_the_derivative():
    pose, point, step = np.array([1.0, 2.0, 0.7]), np.array([3.0, -1.0, 0.0]), 1e-6
    for axis in range(3):
        moved = pose + step * np.eye(3)[axis]
        change = (se2.compose(moved, point) - se2.compose(pose, point)) / step
        np.testing.assert_allclose(lever(pose, point)[:, axis], change, atol=1e-5)


@pytest.mark.parametrize("order", [1, -1])
def test_roots_are_the_lowest_numbers(order):
    assert roots(6, [link(4, 5, 1.0), link(1, 3, 1.0), link(3, 4, 1.0)][::order]) == [0, 1, 2, 1, 1, 1]
