"""Which of the links between maps can be right together: the strongest consistent structure.

Links are believed one by one with a probability each; together they must also agree around every cycle. The strongest
consistent structure is the set of links, free of contradictions, with the largest sum of log-odds, where closing a
cycle counts in a link's favour. The search begins with the maximum spanning forest; every other link is checked by chi2
against the way through the forest, and links of the forest that others contradict are tried without. A link that other,
nearly as strong structures do without is in doubt: a wrong merge costs more than a refused one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import inverse_jacobian
from mapping import se2

FloatArray = NDArray[np.float64]
_ROUNDS = 20


@dataclass(frozen=True, slots=True)
class ConsistencyRule:
    """When edges contradict each other, and when one is left in doubt.

    chi2: squared normalised error around a cycle at the most; 3 degrees of freedom, 16.27 is 99.9 %. bend_m, bend_rad:
    standard deviation, at the middle of its second map, that each edge gets on top where cycles are checked: maps bend,
    which covariances of single pairs tell in part only. floor_m, floor_rad: the same for the poses: pairs that share a
    map err alike. least_log_odds: by how much the best structure must outweigh the best
    one without an edge, where cycles contradict: 2.2 is the probability 0.9. certain: log-odds that count at the most.
    agreement: log-odds that an edge adds by closing a cycle; 3 says that a wrong one does so once in 20 times.
    """

    chi2: float = 16.27
    bend_m: float = 0.05
    bend_rad: float = 0.01
    floor_m: float = 0.01
    floor_rad: float = 0.002
    least_log_odds: float = 2.2
    certain: float = 7.0
    agreement: float = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """An edge between the middles of maps number a and b, with its covariance, the floor in it, and its log-odds."""

    a: int
    b: int
    pose: FloatArray
    covariance: FloatArray
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """Links that are kept (in a consistent structure), that contradict it with their chi2 and cycle, and the weight."""

    kept: tuple[int, ...]
    contradicting: Mapping[int, tuple[float, tuple[int, ...]]]
    weight: float


def without_doubt(count: int, links: Sequence[Link], rule: ConsistencyRule) -> tuple[Choice, frozenset[int]]:
    """Return the strongest structure of links, strongest first, and which of its links are in doubt.

    A link is in doubt if a structure without it is about as strong, or if it is not part of the strongest structure
    without those in doubt.
    """
    best, loose = _strongest(count, links, rule)
    choice, doubtful = best, set[int]()
    while True:
        # Only links that another one contradicts can be in doubt: without any other nothing would come in return.
        found = {
            number
            for number in _suspects(choice)
            if choice.weight - _strongest(count, links, rule, loose, frozenset({*doubtful, number}))[0].weight
            < min(rule.least_log_odds, links[number].weight)
        }
        if not found:
            return best, frozenset(doubtful)
        doubtful |= found
        choice, _ = _strongest(count, links, rule, loose, frozenset(doubtful))
        doubtful |= set(best.kept) - set(choice.kept)


def _suspects(choice: Choice) -> list[int]:
    """Return the links that are part of a cycle with a contradiction, apart from the one that contradicts."""
    return sorted({number for _, way in choice.contradicting.values() for number in way})


def _strongest(
    count: int,
    links: Sequence[Link],
    rule: ConsistencyRule,
    loose: frozenset[int] = frozenset(),
    without: frozenset[int] = frozenset(),
) -> tuple[Choice, frozenset[int]]:
    """Search for the consistent structure of the largest weight; return it, and the links kept out of its forest.

    Links of the forest that others contradict are kept out of it in turn, as long as that adds to the weight.
    """
    best = _chosen(count, links, rule, loose, without)
    for _ in range(_ROUNDS):
        changed = [loose | {number} for number in _suspects(best)] + [loose - {number} for number in sorted(loose)]
        tried = [(_chosen(count, links, rule, each, without), each) for each in changed]
        if not tried:
            break
        choice, other = max(tried, key=lambda each: each[0].weight)
        if choice.weight <= best.weight + 1e-9:
            break
        best, loose = choice, other
    return best, loose


def _chosen(
    count: int, links: Sequence[Link], rule: ConsistencyRule, loose: frozenset[int], without: frozenset[int]
) -> Choice:
    """Return the maximum spanning forest of links (sorted, strongest first), and the others that agree with it.

    loose: links that are no part of the forest, but checked against it like the others; without: those left out.
    """
    root = list(range(count))
    neighbours: list[dict[int, int]] = [{} for _ in range(count)]
    forest: set[int] = set()
    for number, link in enumerate(links):
        if number in loose or number in without or root[link.a] == root[link.b]:
            continue
        root = _joined(root, link)
        neighbours[link.a][link.b] = neighbours[link.b][link.a] = number
        forest.add(number)
    weight = sum(links[number].weight for number in sorted(forest))
    kept, contradicting = set(forest), {}
    for number, link in enumerate(links):
        if number in forest or number in without or root[link.a] != root[link.b]:
            continue
        way = _way(neighbours, links, link.a, link.b)
        chi2 = _misfit(link, [links[each] for each in way], np.diag([rule.bend_m, rule.bend_m, rule.bend_rad]) ** 2)
        if chi2 <= rule.chi2:
            kept.add(number)
            weight += link.weight + rule.agreement
        else:
            contradicting[number] = (chi2, tuple(way))
    return Choice(tuple(sorted(kept)), contradicting, weight)


def _way(neighbours: Sequence[Mapping[int, int]], links: Sequence[Link], start: int, end: int) -> list[int]:
    """Return the numbers of the links from one map to another through the forest."""
    came: dict[int, int | None] = {start: None}
    open_maps = [start]
    while end not in came:
        here = open_maps.pop()
        for there, link in neighbours[here].items():
            if there not in came:
                came[there] = link
                open_maps.append(there)
    way, at = [], end
    while (number := came[at]) is not None:
        way.append(number)
        at = links[number].a if links[number].b == at else links[number].b
    return way[::-1]


def _misfit(link: Link, way: Sequence[Link], bend: FloatArray) -> float:
    """Return the squared normalised error (3 degrees of freedom) between a link and a way from its a to its b.

    bend (3, 3): covariance that each of them gets on top of its own.
    """
    pose, covariance, here = se2.IDENTITY, np.zeros((3, 3)), link.a
    for each in way:
        step, own, there = each.pose, each.covariance, each.b
        if each.a != here:
            turned = inverse_jacobian(each.pose)
            step, own, there = se2.inverse(each.pose), turned @ each.covariance @ turned.T, each.a
        before = lever(pose, step)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        onto = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        covariance = before @ covariance @ before.T + onto @ (own + bend) @ onto.T
        pose, here = se2.compose(pose, step), there
    error = np.asarray(pose) - link.pose
    error[2] = se2.wrap_angle(error[2])
    return float(error @ np.linalg.solve(covariance + link.covariance + bend, error))


def roots(count: int, links: Sequence[Link]) -> list[int]:
    """Return for each map the lowest number of those that it hangs together with."""
    root = list(range(count))
    for link in links:
        root = _joined(root, link)
    return root


def _joined(root: Sequence[int], link: Link) -> list[int]:
    """Return the groups after a link joined two of them under the lower number."""
    low, high = sorted((root[link.a], root[link.b]))
    return [low if each == high else each for each in root]


def lever(pose: FloatArray, point: FloatArray) -> FloatArray:
    """Return the derivative (3, 3) of a frame's pose at another point (x, y, 0) of its body, by that of its origin."""
    x, y = se2.transform_points(np.array([0.0, 0.0, pose[2]]), point[:2]).tolist()
    return np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
