"""A simulated car with a clockwise laser that turns while the car moves, in a room without any symmetry.

For what needs a way back to the start there is a building: a ring corridor with rooms, seen by a car that drives or
from single places, as keyframes are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.keyframes import KeyframeStore
from mapping.mount import Mount
from mapping.raycast import cast_rays
from mapping.sensor_models import LidarModel
from mapping.surface import surface_of
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]

ROOM_CELL_M = 0.02
START_NS = 1_700_000_000_123_456_789


def asymmetric_room() -> NDArray[np.bool_]:
    """Return a room of 8 x 6 m (rows = y, 2 cm) with a niche, a pillar and a cupboard: no mirror image fits it."""
    occupied = np.ones((300, 400), dtype=np.bool_)
    occupied[10:290, 10:390] = False
    occupied[200:300, 10:110] = True  # upper left corner: x 0.2..2.2 m, y 4..6 m
    occupied[10:40, 250:330] = True  # cupboard at the lower wall: x 5..6.6 m, y 0.2..0.8 m
    occupied[190:215, 290:310] = True  # pillar: x 5.8..6.2 m, y 3.8..4.3 m
    return occupied


def carve(width_m: float, height_m: float, *free: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    """Return a solid block with rectangles x0, y0, x1, y1 (m) taken out of it."""
    occupied = np.ones((round(height_m / ROOM_CELL_M), round(width_m / ROOM_CELL_M)), dtype=np.bool_)
    for rectangle in free:
        x0, y0, x1, y1 = (round(edge / ROOM_CELL_M) for edge in rectangle)
        occupied[y0:y1, x0:x1] = False
    return occupied


def ring_building() -> NDArray[np.bool_]:
    """Return 20 x 14 m: a corridor 1.6 m wide around a block of 8.8 x 2.8 m, and eight rooms of different sizes."""
    occupied = carve(
        20.0, 14.0,
        (4.0, 4.0, 16.0, 10.0),
        (4.2, 0.4, 7.4, 3.8), (5.0, 3.8, 6.0, 4.0),
        (7.6, 1.4, 12.0, 3.8), (10.4, 3.8, 11.4, 4.0),
        (12.2, 0.6, 15.8, 3.8), (13.0, 3.8, 13.8, 4.0),
        (4.2, 10.2, 9.0, 13.6), (7.4, 10.0, 8.6, 10.2),
        (9.2, 10.2, 12.4, 12.6), (9.8, 10.0, 10.6, 10.2),
        (12.6, 10.2, 15.8, 13.2), (14.4, 10.0, 15.4, 10.2),
        (0.6, 4.2, 3.8, 9.0), (3.8, 6.4, 4.0, 7.4),
        (16.2, 5.0, 19.4, 9.8), (16.0, 8.0, 16.2, 9.0),
    )  # fmt: skip
    for x0, y0, x1, y1 in (
        (5.6, 5.6, 14.4, 8.4), (4.4, 1.2, 5.4, 2.2), (9.0, 1.4, 9.6, 2.4), (14.6, 1.4, 15.2, 2.6),
        (5.0, 12.2, 6.6, 12.8), (11.4, 11.0, 12.4, 11.4), (13.4, 12.0, 14.0, 12.6), (1.4, 5.0, 2.2, 6.4),
        (17.6, 7.0, 18.4, 7.6), (8.4, 5.4, 8.8, 5.6), (11.0, 8.4, 11.6, 8.6), (5.4, 6.6, 5.6, 7.2),
    ):  # fmt: skip
        occupied[
            round(y0 / ROOM_CELL_M) : round(y1 / ROOM_CELL_M), round(x0 / ROOM_CELL_M) : round(x1 / ROOM_CELL_M)
        ] = True
    return occupied


@dataclass(frozen=True, slots=True)
class Drive:
    """Twists (vx, vy, wz) of base_link, each held for a number of seconds, from a pose in the room."""

    start: tuple[float, float, float]
    legs: Sequence[tuple[float, tuple[float, float, float]]]

    @property
    def duration_s(self) -> float:
        return sum(seconds for seconds, _ in self.legs)

    def poses(self, times_s: FloatArray) -> FloatArray:
        """Return the poses (N, 3) in the room at times (N,) in seconds from the start."""
        poses = np.empty((len(times_s), 3))
        begin_s, pose = 0.0, np.array(self.start)
        for seconds, twist in self.legs:
            later = times_s >= begin_s
            poses[later] = se2.compose(pose, se2.exp(np.array(twist) * (times_s[later] - begin_s)[:, np.newaxis]))
            begin_s, pose = begin_s + seconds, se2.compose(pose, se2.exp(np.array(twist) * seconds))
        return poses


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedDrive:
    """What a drive gave: scans, wheel odometry at 50 Hz, and the truth in the room's frame at any instant."""

    drive: Drive
    scans: list[LaserScan]
    odometry: list[Odometry]

    @property
    def truth(self) -> Trajectory:
        times_s = np.arange(0.0, self.drive.duration_s, 0.005)
        return Trajectory(START_NS + np.rint(times_s * 1e9).astype(np.int64), self.drive.poses(times_s))


def simulate(
    drive: Drive,
    mount: Mount | None = None,
    *,
    samples: int = 400,
    rate_hz: float = 10.0,
    noise_m: float = 0.01,
    occupied: NDArray[np.bool_] | None = None,
) -> SimulatedDrive:
    """Drive through the room, or what is `occupied`; noise_m: standard deviation of a range, from a fixed seed."""
    mount = mount or Mount()
    generator = np.random.default_rng(20)
    room = asymmetric_room() if occupied is None else occupied
    offsets_s = np.arange(samples) / (samples * rate_hz)
    side = 1.0 if mount.inverted else -1.0  # clockwise seen from above; upside down it turns the other way
    seen_from_above = side * 2.0 * np.pi * np.arange(samples) / samples
    scans = []
    for index in range(int(drive.duration_s * rate_hz)):
        laser = se2.compose(drive.poses(index / rate_hz + offsets_s), mount.pose)
        cells = cast_rays(room, laser[:, :2] / ROOM_CELL_M, laser[:, 2] + seen_from_above, 12.0 / ROOM_CELL_M)
        noisy = cells * ROOM_CELL_M + generator.normal(0.0, noise_m, samples)
        stated = -2.0 * np.pi * np.arange(samples) / samples  # the sensor itself always counts clockwise
        stamp_ns = START_NS + round(index / rate_hz * 1e9)
        scans.append(LaserScan(stamp_ns, stated, np.where(cells > 0, noisy, 0.0), offsets_s, 0.15, 12.0))
    times_s = np.arange(0.0, drive.duration_s, 0.02)
    wheel_poses = se2.between(drive.poses(times_s[:1]), drive.poses(times_s))
    stamps = START_NS + np.rint(times_s * 1e9).astype(np.int64)
    odometry = [Odometry(int(stamp), pose, np.zeros(3)) for stamp, pose in zip(stamps, wheel_poses, strict=True)]
    return SimulatedDrive(drive, scans, odometry)


# Once around the ring corridor at 0.8 m/s and 6 m on: 43 s.
_CORNER, _SHORT_SIDE = (0.6 * np.pi / 1.6, (0.8, 0.0, 0.8 / 0.6)), (3.2 / 0.8, (0.8, 0.0, 0.0))
LAP = Drive(
    start=(8.0, 4.8, 0.0),
    legs=(
        (6.6 / 0.8, (0.8, 0.0, 0.0)),
        *(_CORNER, _SHORT_SIDE, _CORNER),
        (9.2 / 0.8, (0.8, 0.0, 0.0)),
        *(_CORNER, _SHORT_SIDE, _CORNER),
        (8.6 / 0.8, (0.8, 0.0, 0.0)),
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A place to stand in: look around from anywhere, at one instant, with a laser on base_link."""

    occupied: NDArray[np.bool_]
    samples: int = 360
    noise_m: float = 0.01

    def look(self, pose: FloatArray, seed: int = 0) -> FloatArray:
        """Return what is seen from a pose (3,) as points (N, 2) in the body frame."""
        bearings = -2.0 * np.pi * np.arange(self.samples) / self.samples
        starts = np.repeat(np.asarray(pose)[np.newaxis, :2] / ROOM_CELL_M, self.samples, axis=0)
        cells = cast_rays(self.occupied, starts, pose[2] + bearings, 12.0 / ROOM_CELL_M)
        ranges = cells * ROOM_CELL_M + np.random.default_rng(seed).normal(0.0, self.noise_m, self.samples)
        seen = cells > 0
        return (ranges * np.array([np.cos(bearings), np.sin(bearings)])).T[seen]

    def keyframes(self, poses: FloatArray) -> KeyframeStore:
        """Return a store with what is seen from each of the poses (K, 3)."""
        store = KeyframeStore(np.zeros(2))
        for number, pose in enumerate(poses):
            store.add(surface_of(self.look(pose, number), np.zeros(2)))
        return store


WINDING_DRIVE = Drive(
    start=(2.0, 1.5, 0.4),
    legs=(
        (1.0, (0.4, 0.0, 0.0)),
        (2.0, (0.4, 0.0, 0.5)),
        (2.0, (0.4, 0.0, -1.0)),
        (2.5, (0.4, 0.0, 1.0)),
        (1.5, (0.4, 0.0, 0.2)),
        (2.0, (0.4, 0.0, 1.0)),
    ),
)


def hall_and_room() -> NDArray[np.bool_]:
    """Return a hall, y 4.2 to 5.8 m, and a room below it, behind a wall of 0.12 m with a door of 1 m (2 cm cells)."""
    occupied = np.ones((300, 400), dtype=np.bool_)
    occupied[210:290, 10:390] = False
    occupied[10:204, 150:390] = False
    occupied[204:210, 220:270] = False  # door: x 4.4..5.4 m
    occupied[100:140, 200:230] = True  # cupboard in the room: x 4..4.6 m, y 2..2.8 m
    return occupied


@pytest.fixture(scope="session")
def looked_into() -> tuple[NDArray[np.bool_], OccupancyGrid]:
    """The cells of `hall_and_room`, and the map of a drive along the hall, from where the room is seen by its door."""
    cells, generator = hall_and_room(), np.random.default_rng(1)
    builder = GridBuilder(0.05, LidarModel())
    headings = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    for x in np.arange(1.0, 7.5, 0.1):
        laser = np.array([x, 5.0])
        ranges = cast_rays(cells, np.tile(laser / ROOM_CELL_M, (240, 1)), headings, 12.0 / ROOM_CELL_M) * ROOM_CELL_M
        noisy = ranges + generator.normal(0.0, 0.01, 240)
        builder.add_scan(laser, laser + np.column_stack([np.cos(headings), np.sin(headings)]) * noisy[:, np.newaxis])
    return cells, builder.grid()


@pytest.fixture(scope="session")
def room() -> NDArray[np.bool_]:
    """The room's cells (rows, cols) of ROOM_CELL_M, row 0 at y = 0."""
    return asymmetric_room()


@pytest.fixture(scope="session")
def simulate_drive() -> Callable[..., SimulatedDrive]:
    """The simulator: simulate_drive(legs, start=..., mount=..., samples=..., noise_m=..., occupied=...)."""

    def run(
        legs: Sequence[tuple[float, tuple[float, float, float]]],
        *,
        start: tuple[float, float, float] = (2.0, 1.5, 0.4),
        mount: Mount | None = None,
        samples: int = 400,
        noise_m: float = 0.01,
        occupied: NDArray[np.bool_] | None = None,
    ) -> SimulatedDrive:
        return simulate(Drive(start, legs), mount, samples=samples, noise_m=noise_m, occupied=occupied)

    return run


@pytest.fixture(scope="session")
def site() -> type[Site]:
    """Makes a place to look around in, from cells (rows, cols) of ROOM_CELL_M."""
    return Site


@pytest.fixture(scope="session")
def carved() -> Callable[..., NDArray[np.bool_]]:
    """carved(width_m, height_m, (x0, y0, x1, y1), ...): a block with free rectangles in it."""
    return carve


@pytest.fixture(scope="session")
def building() -> Site:
    """The building with the ring corridor."""
    return Site(ring_building())


@pytest.fixture(scope="session")
def lap_poses() -> FloatArray:
    """Where keyframes of a lap through the building lie: (K, 3), 0.25 m apart; from 28.5 m on it was there before."""
    return LAP.poses(np.arange(0.0, LAP.duration_s, 0.25 / 0.8))


@pytest.fixture(scope="session")
def winding() -> SimulatedDrive:
    """Eleven seconds at 0.4 m/s with turns of up to 1 rad/s either way, laser on base_link."""
    return simulate(WINDING_DRIVE)
