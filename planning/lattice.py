"""Every pose that the car can reach from one by short arcs and lines: what is searched where no route can be followed.

Hybrid A* (Dolgov, Thrun, Montemerlo, Diebel, Int. J. Robotics Research 29, 2010): best first over cells of place and
heading, of which each keeps the first pose that was reached in it, with the guide's cost to go as a bound and the word
to the end tried now and then. From the goal it goes against the direction of driving. Where no cell is left, the car
has no way out, at this width of cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.edges import DUBINS, STEP_M, edge_is_free, steer, steering
from planning.footprint import Distances, Mask
from planning.heap import pop, push
from planning.pieces import Pieces, words_between
from planning.reeds_shepp import PIECES, drive
from planning.route import costs_to

FloatArray = NDArray[np.float64]
Costs = NDArray[np.float32]

_CELLS_PER_STEP = 1.5
_SWING = 0.6  # of a cell, by which the farthest corner moves between two headings
_GREED = 2.0  # the cost to go counts so many times
_WORDS_M, _WORDS_EVERY = 5.0, 16  # so near the end every so manieth pose tries the word to it
_MOVES = 6  # three turns, two gears


class Outcome(IntEnum):
    """How a part of a search ended: with poses left to look at, with a way, or with none left."""

    open = 0
    found = 1
    exhausted = 2


class _Space(NamedTuple):
    """What the compiled code asks whether the car fits, as in `edges`."""

    blocked: Mask
    distance_m: Distances
    cell_m: float
    corners: FloatArray
    outer_radius_m: float


class _Car(NamedTuple):
    """The kind of words, and what they cost, as in `edges.steer`."""

    kind: int
    radius_m: float
    reverse_cost: float
    cusp_cost_m: float


class _Lattice(NamedTuple):
    """Width of its cells, how many headings, length of a move; sense: 1 along the direction of driving, -1 against it.

    to_go: what the guide's cells cost from the end (R, C), in their width guide_m.
    """

    cell_m: float
    headings: int
    step_m: float
    sense: int
    end: FloatArray
    to_go: Costs
    guide_m: float


class _Tree(NamedTuple):
    """Poses (N, 3), cost in m (N,), parents (N,), and the gear and turn of the move that led there (N,).

    keys and items: a heap of those to look at, table: an open-addressing set of the cells that are taken;
    counts: poses, items in the heap, poses looked at; best (1,): the least cost to go so far.
    """

    poses: FloatArray
    cost_m: FloatArray
    parents: NDArray[np.int32]
    gears: NDArray[np.int8]
    turns: NDArray[np.int8]
    keys: FloatArray
    items: NDArray[np.int32]
    table: NDArray[np.int64]
    counts: NDArray[np.int64]
    best: FloatArray


@dataclass(frozen=True, slots=True)
class LatticeWidth:
    """cell_m: width of a cell; headings: how many to a turn."""

    cell_m: float
    headings: int

    @classmethod
    def of(cls, costmap: Costmap, share: float) -> LatticeWidth:
        """Return cells of a share of the car's inradius wide, and headings that move its corners by as much."""
        cell_m = share * costmap.vehicle.inradius_m
        return cls(cell_m, math.ceil(2.0 * math.pi * costmap.vehicle.outer_radius_m / (_SWING * cell_m)))


class LatticeSearch:
    """A search from one of the local poses ends (2, 3) for a way between them, from the goal where `backwards`."""

    def __init__(self, costmap: Costmap, ends: FloatArray, width: LatticeWidth, *, backwards: bool) -> None:
        vehicle, guide = costmap.vehicle, costmap.guide
        cell_m = costmap.grid.resolution_m
        root, end = (ends[1], ends[0]) if backwards else (ends[0], ends[1])
        to_go = costs_to(guide.cost, guide.cell(float(end[0]), float(end[1]), cell_m))
        self._space = _Space(
            costmap.blocked, costmap.to_blocked_m, cell_m, vehicle.corners, vehicle.outer_radius_m
        )  # fmt: skip
        self._car = _Car(*steering(vehicle))
        step_m, sense = _CELLS_PER_STEP * width.cell_m, -1 if backwards else 1
        self._lattice = _Lattice(
            width.cell_m, width.headings, step_m, sense, np.ascontiguousarray(end), to_go, guide.factor * cell_m
        )
        self._tree = _rooted(np.ascontiguousarray(root), 1 << 14)
        self._node = -1

    @property
    def count(self) -> int:
        """Poses that were reached."""
        return int(self._tree.counts[0])

    @property
    def poses(self) -> FloatArray:
        """Local poses (N, 3) that were reached, the root first."""
        return self._tree.poses[: self.count]

    def advance(self, most: int) -> Outcome:
        """Look at so many poses more, at most."""
        while self.count + _MOVES * most > len(self._tree.poses):
            self._tree = _grown(self._tree)
        outcome, self._node = _search(self._space, self._car, self._lattice, self._tree, most)
        return Outcome(outcome)

    def way(self) -> Pieces:
        """Return what was found, from start to goal; moves stay as short as they were checked."""
        tree, sense = self._tree, self._lattice.sense
        nodes = [self._node]
        while nodes[-1]:
            nodes.append(int(tree.parents[nodes[-1]]))
        if sense > 0:
            nodes.reverse()
        moved = np.array(nodes[1:] if sense > 0 else nodes[:-1], dtype=np.intp)
        lengths = tree.gears[moved].astype(np.float64) * self._lattice.step_m
        moves = Pieces(tree.poses[nodes], lengths, tree.turns[moved].astype(np.int64))
        node, end = tree.poses[self._node], self._lattice.end
        word = words_between(np.array([node, end] if sense > 0 else [end, node]), *self._car)
        return moves.followed_by(word) if sense > 0 else word.followed_by(moves)


def _rooted(root: FloatArray, size: int) -> _Tree:
    tree = _Tree(
        poses=np.empty((size, 3)),
        cost_m=np.empty(size),
        parents=np.empty(size, np.int32),
        gears=np.zeros(size, np.int8),
        turns=np.zeros(size, np.int8),
        keys=np.empty(size),
        items=np.empty(size, np.int32),
        table=np.full(2 * size, -1, np.int64),
        counts=np.array([1, 1, 0], np.int64),
        best=np.array([math.inf]),
    )
    tree.poses[0], tree.cost_m[0], tree.parents[0], tree.keys[0], tree.items[0] = root, 0.0, 0, 0.0, 0
    return tree


def _grown(tree: _Tree) -> _Tree:
    """Return a tree with the same poses and twice the room."""
    size = 2 * len(tree.poses)
    more = _rooted(tree.poses[0], size)
    for name in ("poses", "cost_m", "parents", "gears", "turns", "keys", "items"):
        old = getattr(tree, name)
        getattr(more, name)[: len(old)] = old
    _rehash(tree.table, more.table)
    return more._replace(counts=tree.counts, best=tree.best)


@njit(cache=True)
def _search(space: _Space, car: _Car, lattice: _Lattice, tree: _Tree, most: int) -> tuple[int, int]:
    """Look at most poses; return an Outcome, and the pose from which the word to the end is free."""
    word, word_turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    move, move_turn = np.empty(1), np.empty(1, np.int64)
    counts = tree.counts
    for _ in range(most):
        if counts[1] == 0:
            return 2, -1
        node = tree.items[0]
        counts[1] = pop(tree.keys, tree.items, counts[1])
        counts[2] += 1
        x, y, yaw = tree.poses[node, 0], tree.poses[node, 1], tree.poses[node, 2]
        to_go_m = _to_go_m(lattice, x, y)
        if to_go_m < tree.best[0] or (to_go_m < _WORDS_M and counts[2] % _WORDS_EVERY == 0):
            tree.best[0] = min(tree.best[0], to_go_m)
            if _word_is_free(space, car, lattice, x, y, yaw, word, word_turns):
                return 1, node
        for number in range(_MOVES):
            turn, gear = number // 2 - 1, 1 - 2 * (number % 2)
            if gear < 0 and car.kind == DUBINS:
                continue
            move[0], move_turn[0] = lattice.sense * gear * lattice.step_m, turn
            at_x, at_y, at_yaw = drive(x, y, yaw, move[0], turn, car.radius_m)
            to_go_m = _to_go_m(lattice, at_x, at_y)
            if to_go_m == math.inf:
                continue
            cell = _cell(lattice, at_x, at_y, at_yaw)
            place, is_taken = _find(tree.table, cell)
            if is_taken or not _is_free(space, car, move, move_turn, x, y, yaw):
                continue
            tree.table[place] = cell
            cost_m = tree.cost_m[node] + lattice.step_m * (car.reverse_cost if gear < 0 else 1.0)
            if tree.gears[node] == -gear:
                cost_m += car.cusp_cost_m
            new = counts[0]
            tree.poses[new, 0], tree.poses[new, 1], tree.poses[new, 2] = at_x, at_y, at_yaw
            tree.cost_m[new], tree.parents[new], tree.gears[new], tree.turns[new] = cost_m, node, gear, turn
            _, _, counts[1] = push(tree.keys, tree.items, counts[1], cost_m + _GREED * to_go_m, new)
            counts[0] += 1
    return 0, -1


@njit(cache=True)
def _word_is_free(
    space: _Space,
    car: _Car,
    lattice: _Lattice,
    x: float,
    y: float,
    yaw: float,
    word: FloatArray,
    turns: NDArray[np.int64],
) -> bool:
    """Whether the car may drive the word between a pose and the end."""
    end_x, end_y, end_yaw = lattice.end[0], lattice.end[1], lattice.end[2]
    if lattice.sense < 0:
        x, y, yaw, end_x, end_y, end_yaw = end_x, end_y, end_yaw, x, y, yaw
    costs = (car.radius_m, car.reverse_cost, car.cusp_cost_m)
    steer(car.kind, x, y, yaw, end_x, end_y, end_yaw, *costs, word, turns)
    return _is_free(space, car, word, turns, x, y, yaw)


@njit(cache=True)
def _is_free(
    space: _Space, car: _Car, lengths: FloatArray, turns: NDArray[np.int64], x: float, y: float, yaw: float
) -> bool:
    """Whether the car may drive pieces from a pose on."""
    free: bool = edge_is_free(
        space.blocked, space.distance_m, space.cell_m, space.corners, space.outer_radius_m,
        lengths, turns, x, y, yaw, car.radius_m, STEP_M,
    )  # fmt: skip
    return free


@njit(cache=True)
def _to_go_m(lattice: _Lattice, x: float, y: float) -> float:
    """Return what is left to go by the guide; inf outside of the grid or where the rear axle cannot be."""
    rows, cols = lattice.to_go.shape
    row, col = math.floor(y / lattice.guide_m), math.floor(x / lattice.guide_m)
    if row < 0 or col < 0 or row >= rows or col >= cols:
        return math.inf
    to_go_m: float = lattice.to_go[row, col] * lattice.guide_m
    return to_go_m


@njit(cache=True)
def _cell(lattice: _Lattice, x: float, y: float, yaw: float) -> int:
    """Return the number of the cell of a pose inside the grid."""
    heading = int(yaw % (2.0 * math.pi) / (2.0 * math.pi) * lattice.headings) % lattice.headings
    return ((int(y / lattice.cell_m) << 24) + int(x / lattice.cell_m)) * lattice.headings + heading


@njit(cache=True)
def _find(table: NDArray[np.int64], cell: int) -> tuple[int, bool]:
    """Return where in the table a cell is or would be, and whether it is."""
    mask = len(table) - 1
    place = ((cell ^ (cell >> 21)) * 0x9E3779B1 >> 7) & mask
    while table[place] != -1:
        if table[place] == cell:
            return place, True
        place = (place + 1) & mask
    return place, False


@njit(cache=True)
def _rehash(old: NDArray[np.int64], new: NDArray[np.int64]) -> None:
    for cell in old:
        if cell != -1:
            place, _ = _find(new, cell)
            new[place] = cell
