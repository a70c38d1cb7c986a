"""Many maps at once: the pose of every map in its group, from accepted alignments that agree with each other.

Maps are nodes, accepted alignments edges. The strongest consistent structure (fusion/consistency.py) says which edges
to believe together; what contradicts it is withdrawn. The poses come from a pose graph over all edges left, with their
covariances. Poses are taken between the middles of the maps: in a frame far away, angles would move them by metres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import inverse_jacobian
from fusion.consistency import Choice, ConsistencyRule, Link, lever, roots, without_doubt
from mapping import se2
from mapping.pose_graph import Constraints, linearise, optimise

FloatArray = NDArray[np.float64]
Pair = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class MapEdge:
    """An accepted alignment: the pose T_a_b (3,) of map b's frame in map a's, covariance (3, 3), probability."""

    a: str
    b: str
    T_a_b: FloatArray
    covariance: FloatArray
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMap:
    """The pose (3,) of a map's frame in its group's, and its covariance (3, 3) in x, y (m) and yaw (rad)."""

    T_group_map: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MapGroup:
    """Maps that hang together, in the frame of the first one; edges: the pairs that hold them."""

    maps: Mapping[str, PlacedMap]
    edges: tuple[Pair, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Withdrawal:
    """An edge that is not believed beside the others, and why."""

    pair: Pair
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """The groups, in the order of their first maps, and the edges that were withdrawn."""

    groups: tuple[MapGroup, ...]
    withdrawn: tuple[Withdrawal, ...]


def connect(
    middles: Mapping[str, FloatArray],
    edges: Iterable[MapEdge],
    rule: ConsistencyRule | None = None,
    titles: Mapping[str, str] | None = None,
) -> Structure:
    """Return the strongest consistent structure and every map's pose.

    middles: the middle (2,) in m of each map's known cells, in its frame. Their order is the rank of the maps: a
    group's frame is that of its first map. titles: what maps are called in reasons, their names otherwise. The order
    of the edges changes nothing, nor does which map of an edge is a.
    """
    rule = rule or ConsistencyRule()
    names = list(middles)
    called = [(titles or {}).get(name, name) for name in names]
    numbers = {name: number for number, name in enumerate(names)}
    at = [np.append(np.asarray(middle, np.float64), 0.0) for middle in middles.values()]
    links = sorted((_link(edge, numbers, at, rule) for edge in edges), key=lambda link: (-link.weight, link.a, link.b))
    kept: list[Link] = []
    withdrawn: list[Withdrawal] = []
    for inside in _hanging_together(len(names), links):
        choice, doubtful = without_doubt(len(names), inside, rule)
        kept += [inside[number] for number in choice.kept if number not in doubtful]
        lost = sorted({*range(len(inside))} - {*choice.kept} | doubtful)
        withdrawn += [
            Withdrawal(_named(inside[number], names), _why(number, choice, inside, called)) for number in lost
        ]
    groups = _groups(names, at, sorted(kept, key=lambda link: (link.a, link.b)))
    return Structure(tuple(groups), tuple(sorted(withdrawn, key=lambda each: each.pair)))


def carried_covariance(T_group_map: FloatArray, covariance: FloatArray, T_map_body: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) in the group's frame of a pose (3,) that is fixed in a map, from the map's own."""
    jacobian = lever(T_group_map, T_map_body)
    return np.asarray(jacobian @ covariance @ jacobian.T)


def _named(link: Link, names: Sequence[str]) -> Pair:
    return names[link.a], names[link.b]


def _why(number: int, choice: Choice, links: Sequence[Link], names: Sequence[str]) -> str:
    if number not in choice.contradicting:
        return "in doubt: of the pairs that contradict each other this one may be the wrong one"
    chi2, way = choice.contradicting[number]
    through = ", ".join(" - ".join(_named(links[each], names)) for each in way)
    return f"contradicts the way by {through}: chi2 {chi2:.0f} around the cycle"


def _hanging_together(count: int, links: Sequence[Link]) -> list[list[Link]]:
    """Return the links of each set of maps that links connect, in their order."""
    root = roots(count, links)
    return [[link for link in links if root[link.a] == each] for each in sorted({root[link.a] for link in links})]


def _link(edge: MapEdge, numbers: Mapping[str, int], at: Sequence[FloatArray], rule: ConsistencyRule) -> Link:
    """Return an edge as a link from the map of the lower number to the other one."""
    a, b, pose, covariance = numbers[edge.a], numbers[edge.b], np.asarray(edge.T_a_b, np.float64), edge.covariance
    if a > b:
        jacobian = inverse_jacobian(pose)
        a, b, pose, covariance = b, a, se2.inverse(pose), jacobian @ covariance @ jacobian.T
    moved = se2.compose(se2.compose(se2.inverse(at[a]), pose), at[b])
    jacobian = lever(pose, at[b])
    covariance = jacobian @ covariance @ jacobian.T + np.diag([rule.floor_m, rule.floor_m, rule.floor_rad]) ** 2
    probability = min(max(edge.probability, 1e-9), 1.0 - 1e-9)
    return Link(a, b, moved, covariance, min(math.log(probability / (1.0 - probability)), rule.certain))


def _groups(names: Sequence[str], at: Sequence[FloatArray], links: Sequence[Link]) -> Iterable[MapGroup]:
    """Yield the groups that links make, each with its poses."""
    root = roots(len(names), links)
    for first in sorted(set(root)):
        members = [number for number, each in enumerate(root) if each == first]
        inside = [link for link in links if root[link.a] == first]
        poses, covariances = _refined(members, inside)
        maps = {}
        for number, pose, covariance in zip(members, poses, covariances, strict=True):
            T_first_middle = se2.compose(at[first], pose)
            jacobian = lever(T_first_middle, se2.inverse(at[number]))
            placed = se2.compose(T_first_middle, se2.inverse(at[number])) if number != first else se2.IDENTITY
            maps[names[number]] = PlacedMap(placed, jacobian @ covariance @ jacobian.T)
        yield MapGroup(maps, tuple((names[link.a], names[link.b]) for link in inside))


def _refined(members: Sequence[int], links: Sequence[Link]) -> tuple[FloatArray, FloatArray]:
    """Return the poses (M, 3) of the members' middles in the first one's, and covariances (M, 3, 3); it has none."""
    count = len(members)
    if count == 1:
        return np.zeros((1, 3)), np.zeros((1, 3, 3))
    row = {number: place for place, number in enumerate(members)}
    measured = np.array([link.pose for link in links])
    turned = np.zeros((len(links), 3, 3))
    turned[:, 2, 2] = 1.0
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(measured[:, 2])
    turned[:, 0, 1], turned[:, 1, 0] = np.sin(measured[:, 2]), -np.sin(measured[:, 2])
    covariances = turned @ np.array([link.covariance for link in links]) @ turned.transpose(0, 2, 1)
    constraints = Constraints(
        np.array([row[link.a] for link in links], np.int64),
        np.array([row[link.b] for link in links], np.int64),
        measured,
        np.linalg.inv(covariances),
        np.zeros(len(links), np.bool_),
    )
    poses = optimise(_first_poses(count, constraints), constraints, iterations=50).poses
    return poses, _covariances(poses, constraints)


def _first_poses(count: int, constraints: Constraints) -> FloatArray:
    """Return poses (count, 3) along the constraints, the first ones first, from pose 0."""
    poses = np.zeros((count, 3))
    placed = {0}
    while len(placed) < count:
        for first, second, pose in zip(
            constraints.first.tolist(), constraints.second.tolist(), constraints.T_first_second, strict=True
        ):
            if (first in placed) == (second in placed):
                continue
            known, new, step = (first, second, pose) if first in placed else (second, first, se2.inverse(pose))
            poses[new] = se2.compose(poses[known], step)
            placed.add(new)
            break
    return poses


def _covariances(poses: FloatArray, constraints: Constraints) -> FloatArray:
    """Return the covariance (K, 3, 3) of each pose when pose 0 is held: blocks of the inverse of the normal matrix."""
    count = len(poses)
    hessians, _ = linearise(poses, constraints, np.ones(len(constraints)))
    normal = np.zeros((3 * count, 3 * count))
    for first, second, block in zip(constraints.first, constraints.second, hessians, strict=True):
        places = np.r_[3 * first : 3 * first + 3, 3 * second : 3 * second + 3]
        normal[np.ix_(places, places)] += block
    inverse = np.zeros_like(normal)
    inverse[3:, 3:] = np.linalg.inv(normal[3:, 3:])
    return np.stack([inverse[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] for n in range(count)])
