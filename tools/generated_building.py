"""Buildings by seed: rooms along a corridor, doors, furniture of several heights, and drives through the rooms.

Sizes, walls, doors and furniture all differ from seed to seed. What a laser at 0.19 m and a camera see of them differs:
tables (for the laser four legs), and things lower than the laser's plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.trajectory import Trajectory
from tools.errors import ToolError
from tools.simulator import drive_along
from tools.solid_world import ROOM_HEIGHT_M, SolidWorld

FloatArray = NDArray[np.float64]
Box = tuple[float, float, float, float]  # x0, y0, x1, y1 in m

_CELL_M = 0.02
_MARGIN_M = 0.5
_WALL_M = 0.12
_TOUR_FROM_WALL_M = 1.05  # of the way round a room
_CLEAR_OF_DOOR_M = 0.45
_LEG_M, _TOP_M = 0.06, 0.04  # of a table
_CAR_M = ((0.0, 0.16), (0.25, 0.16))  # circles that cover a QCar: how far ahead of the rear axle, radius
_TRIALS = 60


@dataclass(frozen=True, slots=True)
class Room:
    """The inside of a room in m, the middle of its door, and the point of the corridor in front of that."""

    inside: Box
    door: tuple[float, float]
    corridor: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """A building in its own frame, lower-left corner at the origin; rooms in the order of their doors along x."""

    world: SolidWorld
    rooms: tuple[Room, ...]

    def drive(self, visits: Sequence[int], turns_left: Sequence[bool], speed_mps: float) -> Trajectory:
        """Return the drive of a car that goes round each of the rooms, in this order and sense, and ends outside.

        It starts within the first room.
        """
        points: list[tuple[float, float]] = []
        for visit, is_left in zip(visits, turns_left, strict=True):
            room = self.rooms[visit]
            if points:
                points += [room.corridor, room.door]
            points += [*_round_tour(room, turns_left=is_left), room.door, room.corridor]
        return drive_along(_without_repeats(points), speed_mps)

    def is_clear(self, drive: Trajectory) -> bool:
        """Whether a car on a drive touches nothing, also no table."""
        free = (self.world.heights_m == 0.0).astype(np.uint8)
        clearance_m = cv2.distanceTransform(free, cv2.DIST_L2, 5) * self.world.resolution_m
        x, y, yaw = drive.poses.T
        for ahead_m, radius_m in _CAR_M:
            places = np.column_stack([x + ahead_m * np.cos(yaw), y + ahead_m * np.sin(yaw)]) - self.world.origin[:2]
            cols, rows = np.floor(places.T / self.world.resolution_m).astype(int)
            if clearance_m[rows, cols].min() < radius_m:
                return False
        return True


@dataclass(frozen=True, slots=True, eq=False)
class TwoDrives:
    """A building and two cars in it, each with its rooms; both start at instant 0 in rooms of their own."""

    building: Building
    visits: tuple[tuple[int, ...], tuple[int, ...]]
    drives: tuple[Trajectory, Trajectory]


def two_drives(seed: int, speeds_mps: tuple[float, float] = (0.6, 0.5)) -> TwoDrives:
    """Return the building of a seed with two drives that have two rooms and the corridor there in common."""
    random = np.random.default_rng([seed, 11])
    for _ in range(_TRIALS):
        building = _building(random)
        count = len(building.rooms)
        first = int(random.integers(0, count - 4))
        rooms = [*range(first, first + 5)]
        if random.random() < 0.5:  # the first car comes from the right
            rooms.reverse()
        visits = (tuple(rooms[:4]), tuple(rooms[:1:-1]))
        a, b = (
            building.drive(each, [bool(left) for left in random.integers(0, 2, len(each))], speed_mps)
            for each, speed_mps in zip(visits, speeds_mps, strict=True)
        )
        if building.is_clear(a) and building.is_clear(b):
            return TwoDrives(building, visits, (a, b))
    raise ToolError(f"seed {seed}: no building out of {_TRIALS} lets both cars through: choose another seed")


@dataclass(slots=True)
class _Plan:
    """Heights and bottoms while they are drawn, in cells of _CELL_M."""

    width_m: float
    height_m: float
    heights: NDArray[np.float32] = field(init=False)
    bottoms: NDArray[np.float32] = field(init=False)

    def __post_init__(self) -> None:
        rows, cols = (round((size + 2 * _MARGIN_M) / _CELL_M) for size in (self.height_m, self.width_m))
        self.heights, self.bottoms = np.zeros((rows, cols), np.float32), np.zeros((rows, cols), np.float32)

    def block(self, box: Box, height_m: float, bottom_m: float = 0.0) -> None:
        """Put a box down, in place of what stands there."""
        (x0, x1), (y0, y1) = (sorted((box[axis], box[axis + 2])) for axis in (0, 1))
        cols = slice(*(round((x + _MARGIN_M) / _CELL_M) for x in (x0, x1)))
        rows = slice(*(round((y + _MARGIN_M) / _CELL_M) for y in (y0, y1)))
        self.heights[rows, cols], self.bottoms[rows, cols] = height_m, bottom_m

    def wall(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Put up a wall along a line, up to the ceiling."""
        half = 0.5 * _WALL_M
        self.block((min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half), ROOM_HEIGHT_M)

    def gap(self, box: Box) -> None:
        """Take away what stands in a box."""
        self.block(box, 0.0)

    def table(self, box: Box, height_m: float) -> None:
        """Put down a table with four legs."""
        x0, y0, x1, y1 = box
        self.block(box, height_m, height_m - _TOP_M)
        for x in (x0, x1 - _LEG_M):
            for y in (y0, y1 - _LEG_M):
                self.block((x, y, x + _LEG_M, y + _LEG_M), height_m)


def _building(random: np.random.Generator) -> Building:
    """Draw a building: two rows of rooms along a corridor."""
    width = random.uniform(14.5, 18.5)
    south, corridor, north = random.uniform(3.5, 4.8), random.uniform(1.7, 2.3), random.uniform(3.5, 4.8)
    low, high = south, south + corridor
    plan = _Plan(width, high + north)
    for x0, y0, x1, y1 in (
        (0.0, 0.0, width, 0.0), (width, 0.0, width, plan.height_m), (width, plan.height_m, 0.0, plan.height_m),
        (0.0, plan.height_m, 0.0, 0.0), (0.0, low, width, low), (0.0, high, width, high),
    ):  # fmt: skip
        plan.wall(x0, y0, x1, y1)
    rooms = []
    for y_door, inner, outer in ((low, low, 0.0), (high, high, plan.height_m)):
        edges = _room_edges(width, random)
        for x0, x1 in pairwise(edges):
            if x1 < width:
                plan.wall(x1, inner, x1, outer)
            half = 0.5 * (random.uniform(1.8, 2.4) if random.random() < 0.15 else random.uniform(1.0, 1.25))
            x_door = random.uniform(x0 + half + 0.35, x1 - half - 0.35)
            plan.gap((x_door - half, y_door - _WALL_M, x_door + half, y_door + _WALL_M))
            inside = (x0, min(inner, outer), x1, max(inner, outer))
            rooms.append(Room(inside, (x_door, y_door), (x_door, 0.5 * (low + high))))
            _furnish(plan, rooms[-1], half, random)
    rooms.sort(key=lambda room: room.door[0])
    _furnish_corridor(plan, (low, high), rooms, random)
    world = SolidWorld(plan.heights, plan.bottoms, _CELL_M, np.array([-_MARGIN_M, -_MARGIN_M, 0.0]))
    return Building(world, tuple(rooms))


def _room_edges(width_m: float, random: np.random.Generator) -> list[float]:
    """Return the walls between the rooms of a row, with both ends: rooms of 3.3 m or more."""
    count = 3 if width_m < 15.0 or random.random() < 0.4 else 4
    spare = width_m - 3.4 * count
    shares = np.sort(random.uniform(0.0, spare, count - 1))
    inner = 3.4 * np.arange(1, count) + shares
    return [0.0, *inner.tolist(), width_m]


def _furnish(plan: _Plan, room: Room, half_door_m: float, random: np.random.Generator) -> None:
    """Put furniture along the walls of a room, a table or a pillar in its middle where there is space, and a corner."""
    x0, y0, x1, y1 = room.inside
    for _ in range(int(random.integers(2, 5))):
        length, depth = random.uniform(0.5, 1.6), random.uniform(0.3, 0.55)
        gap = 0.5 * _WALL_M + random.uniform(0.02, 0.06)
        side = int(random.integers(4))
        if side < 2:  # along the left or the right wall
            y = random.uniform(y0 + 0.2, y1 - 0.2 - length)
            box = (
                (x0 + gap, y, x0 + gap + depth, y + length)
                if side == 0
                else (x1 - gap - depth, y, x1 - gap, y + length)
            )
        else:
            x = random.uniform(x0 + 0.2, x1 - 0.2 - length)
            box = (
                (x, y0 + gap, x + length, y0 + gap + depth)
                if side == 2
                else (x, y1 - gap - depth, x + length, y1 - gap)
            )
        keep = half_door_m + _CLEAR_OF_DOOR_M
        by_door = min(abs(box[1] - room.door[1]), abs(box[3] - room.door[1])) < 1.0
        if by_door and box[0] < room.door[0] + keep and box[2] > room.door[0] - keep:
            continue
        height = random.uniform(0.11, 0.17) if random.random() < 0.15 else random.uniform(0.4, 2.0)
        plan.block(box, height)
    inner_x, inner_y = (x1 - x0 - 2.0 * _TOUR_FROM_WALL_M, y1 - y0 - 2.0 * _TOUR_FROM_WALL_M)
    if min(inner_x, inner_y) > 1.6:
        half_x, half_y = 0.5 * inner_x - random.uniform(0.55, 0.65), 0.5 * inner_y - random.uniform(0.55, 0.65)
        x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        box = (x - half_x, y - half_y, x + half_x, y + half_y)
        if random.random() < 0.5:
            plan.table(box, random.uniform(0.68, 0.78))
        else:
            plan.block(box, random.uniform(0.4, 1.2))
    if random.random() < 0.5:  # a chimney in a corner, away from the door
        size = random.uniform(0.3, 0.7)
        x = x0 if room.door[0] > 0.5 * (x0 + x1) else x1 - size
        y = y0 if room.door[1] > y0 + 0.5 else y1 - size
        plan.block((x, y, x + size, y + size), ROOM_HEIGHT_M)


def _furnish_corridor(
    plan: _Plan, between: tuple[float, float], rooms: Sequence[Room], random: np.random.Generator
) -> None:
    """Put cupboards along the corridor where no door is."""
    low, high = between
    for _ in range(int(random.integers(2, 5))):
        length, depth, is_low = random.uniform(0.4, 1.2), random.uniform(0.15, 0.3), random.random() < 0.5
        x, gap = random.uniform(0.3, plan.width_m - 0.3 - length), 0.5 * _WALL_M + 0.04
        wall_y = low if is_low else high
        doors = [room.door[0] for room in rooms if abs(room.door[1] - wall_y) < 0.1]
        if any(x - 1.3 < door < x + length + 1.3 for door in doors):
            continue
        y = low + gap if is_low else high - gap - depth
        plan.block((x, y, x + length, y + depth), random.uniform(0.4, 2.0))


def _round_tour(room: Room, *, turns_left: bool) -> list[tuple[float, float]]:
    """Return the corners of a way round the room, from the one that is next to the door."""
    x0, y0, x1, y1 = room.inside
    x0, y0, x1, y1 = x0 + _TOUR_FROM_WALL_M, y0 + _TOUR_FROM_WALL_M, x1 - _TOUR_FROM_WALL_M, y1 - _TOUR_FROM_WALL_M
    door_below = room.door[1] < y0
    near, far = (y0, y1) if door_below else (y1, y0)
    right_first = turns_left == door_below
    first, second = (x1, x0) if right_first else (x0, x1)
    return [(first, near), (first, far), (second, far), (second, near)]


def _without_repeats(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points without those nearer than 1 cm to the one before: a piece of a line needs a direction."""
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(point[0] - kept[-1][0], point[1] - kept[-1][1]) > 0.01:
            kept.append(point)
    return kept
