"""From a route to a path that the car can drive: words between poses along the route, found by a lazy search.

Along the route stand candidate poses in layers, in its direction, askew, and backwards. A* over the words between them
puts the check for collisions off until a word is the most promising one left (lazy evaluation: Cohen, Phillips and
Likhachev, RSS 2014), since a check costs several times what a word does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.edges import STEP_M, edge_is_free, steer
from planning.footprint import Distances, Mask, is_free
from planning.heap import pop, push
from planning.reeds_shepp import PIECES

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LAYER_M = 0.25
_SMOOTH_LAYERS = 2  # to each side, over which the route is averaged
# Headings at a point of the route, from its direction, and how many layers ahead the words lead.
_ASKEW = np.array([0.0, 0.35, -0.35, 0.8, -0.8, math.pi, math.pi + 0.4, math.pi - 0.4])
_AHEAD = np.array([1, 2, 3, 4, 6, 8, 12, 16])
_GREED = 1.15  # prefers words that come far along the route to those that cost least


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Local poses (N, 3) that fit, by rising layer (N,); the first is the start, the last the goal.

    first (L + 1,): index of each layer's first pose; points (L, 2) of the route and what is to go along it (L,), in m.
    """

    poses: FloatArray
    layer: IntArray
    first: IntArray
    points: FloatArray
    to_go_m: FloatArray

    def index_after(self, begin: int, index: int) -> int:
        """Return the number here of a candidate of `after(begin)`."""
        if begin == 0 or index == 0:
            return begin + index
        return int(self.first[int(self.layer[begin]) + 1]) + index - 1

    def after(self, begin: int) -> Candidates:
        """Return a candidate as the start, and those of the layers after its own."""
        if begin == 0:
            return self
        layer = int(self.layer[begin])
        kept = np.concatenate([[begin], np.arange(int(self.first[layer + 1]), len(self.poses))])
        first = np.concatenate([[0], self.first[layer + 1 :] - self.first[layer + 1] + 1])
        return Candidates(self.poses[kept], self.layer[kept] - layer, first, self.points[layer:], self.to_go_m[layer:])


def candidates(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    route_m: FloatArray,
    ends: FloatArray,
) -> Candidates:
    """Put poses that fit along a route (N, 2) in local metres, between the start and the goal, ends (2, 3)."""
    points, along_m = _resampled(np.vstack([ends[:1, :2], route_m[1:-1], ends[1:, :2]]))
    poses, layer = _fitting(blocked, distance_m, cell_m, corners, points, _tangents(points), _ASKEW)
    poses = np.vstack([ends[:1], poses, ends[1:]])
    layer = np.concatenate([[0], layer, [len(points) - 1]])
    first = np.searchsorted(layer, np.arange(len(points) + 1))
    return Candidates(poses, layer, first, points, along_m[-1] - along_m)


def _resampled(route_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (L, 2), L >= 2, about LAYER_M apart on the smoothed route, and how far along each is (L,)."""
    steps = np.hypot(*np.diff(route_m, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(2, round(along[-1] / LAYER_M) + 1)
    at = np.linspace(0.0, along[-1], count)
    points = np.column_stack([np.interp(at, along, route_m[:, axis]) for axis in (0, 1)])
    smooth = points.copy()
    for shift in range(1, _SMOOTH_LAYERS + 1):
        smooth += np.vstack([points[:1]] * shift + [points[:-shift]]) if shift < count else points
        smooth += np.vstack([points[shift:]] + [points[-1:]] * shift) if shift < count else points
    smooth /= 2 * _SMOOTH_LAYERS + 1
    smooth[0], smooth[-1] = points[0], points[-1]
    return smooth, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(smooth, axis=0).T))])


def _tangents(points: FloatArray) -> FloatArray:
    last = len(points) - 1
    before = points[np.maximum(np.arange(len(points)) - 1, 0)]
    after = points[np.minimum(np.arange(len(points)) + 1, last)]
    return np.asarray(np.arctan2(after[:, 1] - before[:, 1], after[:, 0] - before[:, 0]))


@njit(cache=True)
def _fitting(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    points: FloatArray,
    tangent: FloatArray,
    askew: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """Return the poses (N, 3) that fit at the points between the first and the last, and their layers (N,)."""
    poses = np.empty((len(points) * len(askew), 3))
    layer = np.empty(len(poses), dtype=np.int64)
    count = 0
    for place in range(1, len(points) - 1):
        x, y = points[place, 0], points[place, 1]
        for turn in askew:
            yaw = tangent[place] + turn
            if is_free(blocked, distance_m, cell_m, x, y, yaw, corners):
                poses[count, 0], poses[count, 1], poses[count, 2] = x, y, yaw
                layer[count] = place
                count += 1
    return poses[:count].copy(), layer[:count].copy()


@njit(cache=True)
def join(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    kind: int,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
    poses: FloatArray,
    layer: IntArray,
    first: IntArray,
    to_go_m: FloatArray,
    most_checks: int,
) -> IntArray:
    """Return the indices (K,) of the poses of a path from the first to the last, or to the one reached furthest on.

    At most most_checks words are checked. The arguments before poses are those of `edges`, from poses those of
    `Candidates`.
    """
    number, last = len(poses), len(poses) - 1
    cost = np.full(number, np.inf)
    came_from = np.full(number, -1)
    keys, edges, count = np.empty(4096), np.empty(4096, np.int64), 0  # an edge: first pose * number + second pose
    lengths, turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    cost[0] = 0.0
    node, checks, furthest = 0, 0, 0
    while True:
        ahead, ways = _words_ahead(kind, radius, reverse_cost, cusp_cost, poses, layer, first, cost, node)
        for place in range(len(ahead)):
            other = ahead[place]
            key = cost[node] + ways[place] + (0.0 if other == last else _GREED * to_go_m[layer[other]])
            keys, edges, count = push(keys, edges, count, key, node * number + other)
        found = False
        while count and not found and checks < most_checks:
            parent, node = edges[0] // number, edges[0] % number
            count = pop(keys, edges, count)
            if cost[node] < np.inf:
                continue
            x, y, yaw = poses[parent, 0], poses[parent, 1], poses[parent, 2]
            way = steer(
                kind, x, y, yaw, poses[node, 0], poses[node, 1], poses[node, 2],
                radius, reverse_cost, cusp_cost, lengths, turns,
            )  # fmt: skip
            checks += 1
            found = edge_is_free(
                blocked, distance_m, cell_m, corners, outer_radius_m, lengths, turns, x, y, yaw, radius, STEP_M
            )
            if found:
                cost[node], came_from[node] = cost[parent] + way, parent
                if layer[node] > layer[furthest]:
                    furthest = node
        if not found:
            return _chain(came_from, furthest)
        if node == last:
            return _chain(came_from, last)


@njit(cache=True)
def _words_ahead(
    kind: int,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
    poses: FloatArray,
    layer: IntArray,
    first: IntArray,
    cost: FloatArray,
    node: int,
) -> tuple[IntArray, FloatArray]:
    """Return the poses (W,) not reached yet that lie some layers ahead of one, and the last, and what the ways cost."""
    last, layers = len(poses) - 1, len(first) - 1
    ahead, ways = np.empty(len(_AHEAD) * len(_ASKEW) + 1, np.int64), np.empty(len(_AHEAD) * len(_ASKEW) + 1)
    lengths, turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    count = 0
    for step in _AHEAD:
        there = layer[node] + step
        if there >= layers - 1:
            break
        for other in range(first[there], first[there + 1]):
            if cost[other] == np.inf:
                ahead[count] = other
                count += 1
    ahead[count] = last
    count += 1
    for place in range(count):
        other = ahead[place]
        ways[place] = steer(
            kind, poses[node, 0], poses[node, 1], poses[node, 2], poses[other, 0], poses[other, 1], poses[other, 2],
            radius, reverse_cost, cusp_cost, lengths, turns,
        )  # fmt: skip
    return ahead[:count], ways[:count]


@njit(cache=True)
def _chain(came_from: IntArray, last: int) -> IntArray:
    steps, node = 1, last
    while node:
        node = came_from[node]
        steps += 1
    chain = np.empty(steps, dtype=np.int64)
    node = last
    for place in range(steps - 1, -1, -1):
        chain[place] = node
        node = came_from[node]
    return chain
