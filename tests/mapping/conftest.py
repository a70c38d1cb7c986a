"""A simulated car in a room without any symmetry, seen by a clockwise laser that turns while the car moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.raycast import cast_rays
from mapping.slam import Mount
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
    drive: Drive, mount: Mount | None = None, *, samples: int = 400, rate_hz: float = 10.0, noise_m: float = 0.01
) -> SimulatedDrive:
    """Drive through the room; noise_m is the standard deviation of a range, from a fixed seed."""
    mount = mount or Mount()
    generator = np.random.default_rng(20)
    room = asymmetric_room()
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


@pytest.fixture(scope="session")
def room() -> NDArray[np.bool_]:
    """The room's cells (rows, cols) of ROOM_CELL_M, row 0 at y = 0."""
    return asymmetric_room()


@pytest.fixture(scope="session")
def simulate_drive() -> Callable[..., SimulatedDrive]:
    """The simulator: simulate_drive(legs, start=..., mount=..., samples=..., noise_m=...)."""

    def run(
        legs: Sequence[tuple[float, tuple[float, float, float]]],
        *,
        start: tuple[float, float, float] = (2.0, 1.5, 0.4),
        mount: Mount | None = None,
        samples: int = 400,
        noise_m: float = 0.01,
    ) -> SimulatedDrive:
        return simulate(Drive(start, legs), mount, samples=samples, noise_m=noise_m)

    return run


@pytest.fixture(scope="session")
def winding() -> SimulatedDrive:
    """Eleven seconds at 0.4 m/s with turns of up to 1 rad/s either way, laser on base_link."""
    return simulate(WINDING_DRIVE)
