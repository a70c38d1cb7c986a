"""From scans to trajectory and map, one scan at a time.

A pure function of the messages it is given: no clock, no randomness. A recording therefore replays to the same map, bit
for bit. Loop closure is not done here yet: the map drifts as the odometry does.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.deskew import deskew, reference_offset_s
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.odometry import LidarOdometry, OdometrySettings, ScanMatch
from mapping.sensor_models import LidarModel
from mapping.trajectory import Trajectory
from mapping.wheel_odometry import WheelOdometry

FloatArray = NDArray[np.float64]


_SECTORS = 36  # of 10 deg
_LEAST_SECTORS = 12  # a turn with gaps is mapped if samples fall into a third of the circle
_SCANS_TO_STEP_BACK = 3
_MOST_WRONG_STAMPS = 2
_LONGEST_EXTRAPOLATION_S = 0.5  # so long after the last match its velocity says nothing any more


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Where the laser sits on the body: a pose (x, y, yaw) in base_link; inverted for one that hangs upside down."""

    pose: FloatArray = field(default_factory=lambda: np.zeros(3))
    inverted: bool = False

    def to_body(self, angles_rad: FloatArray, ranges_m: FloatArray) -> FloatArray:
        """Return samples (N,) given in the laser frame as points (N, 2) in base_link."""
        side = -1.0 if self.inverted else 1.0
        local = np.column_stack([ranges_m * np.cos(angles_rad), side * ranges_m * np.sin(angles_rad)])
        return se2.transform_points(self.pose, local)


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Everything that decides what the map of given messages looks like."""

    resolution_m: float = 0.05
    odometry: OdometrySettings = OdometrySettings()
    lidar_model: LidarModel = LidarModel()
    use_wheel_odometry: bool = True
    wheels_only: bool = False  # poses from wheel odometry alone: a baseline to compare scan matching with
    wheel_wait_s: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class MappedScan:
    """A scan after mapping: pose (3,) of base_link in the map at stamp_ns, the middle of the turn."""

    stamp_ns: int
    match: ScanMatch
    wheel_guess: bool

    @property
    def pose(self) -> FloatArray:
        """The pose that entered the trajectory."""
        return self.match.pose


@dataclass(slots=True)
class MappingCounters:
    """What became of the scans."""

    mapped: int = 0
    unmatched: int = 0
    skipped_partial: int = 0
    skipped_out_of_order: int = 0
    wheel_guesses: int = 0


class Mapper:
    """Odometry, de-skew and occupancy grid for one robot."""

    def __init__(self, settings: MappingSettings, mount: Mount) -> None:
        self.mount = mount
        self.counters = MappingCounters()
        self._settings = settings
        self._odometry = LidarOdometry(settings.odometry)
        self._builder = GridBuilder(settings.resolution_m, settings.lidar_model)
        self._wheels = WheelOdometry()
        self._waiting: deque[LaserScan] = deque()
        self._stamps: list[int] = []
        self._poses: list[FloatArray] = []
        self._twist = np.zeros(3)
        self._behind = 0
        self._matched_ns = 0  # stamp of the last pose that a match gave

    def add_odometry(self, message: Odometry) -> list[MappedScan]:
        """Take in wheel odometry; return the scans that had waited for it."""
        if not self._settings.use_wheel_odometry:
            return []
        self._wheels.add(message)
        return self._map_ready(message.stamp_ns)

    def add_scan(self, scan: LaserScan) -> list[MappedScan]:
        """Take in a scan; return what could be mapped: it waits while wheel odometry for its time is on the way."""
        end_ns = scan.stamp_ns + round(float(scan.offsets_s.max(initial=0.0)) * 1e9)
        self._waiting.append(scan)
        return self._map_ready(end_ns)

    def finish(self) -> list[MappedScan]:
        """Map what still waits; call once after the last message."""
        return [mapped for _ in range(len(self._waiting)) for mapped in self._map_scan(self._waiting.popleft())]

    @property
    def trajectory(self) -> Trajectory:
        """The poses of base_link in the map so far."""
        return Trajectory(np.array(self._stamps, dtype=np.int64), np.array(self._poses).reshape(-1, 3))

    def grid(self) -> OccupancyGrid:
        """The occupancy grid so far."""
        return self._builder.grid()

    def _map_ready(self, now_ns: int) -> list[MappedScan]:
        """Map the waiting scans whose odometry is there, or has not come within wheel_wait_s of message time."""
        mapped: list[MappedScan] = []
        while self._waiting:
            scan = self._waiting[0]
            end_ns = scan.stamp_ns + round(float(scan.offsets_s.max(initial=0.0)) * 1e9)
            if self._is_awaited(end_ns, now_ns):
                break
            mapped += self._map_scan(self._waiting.popleft())
        return mapped

    def _is_awaited(self, end_ns: int, now_ns: int) -> bool:
        """Whether wheel odometry up to end_ns may still come: it flows, and has not been waited for too long."""
        latest_ns, wait_ns = self._wheels.latest_ns, self._settings.wheel_wait_s * 1e9
        if latest_ns is None or latest_ns >= end_ns:
            return False
        return end_ns - latest_ns <= 2 * wait_ns and now_ns - end_ns <= wait_ns

    def _map_scan(self, scan: LaserScan) -> list[MappedScan]:
        """Predict, de-skew, match, learn, draw."""
        if not scan.complete and (self._waits_for_a_whole_turn() or _seen_sectors(scan) < _LEAST_SECTORS):
            self.counters.skipped_partial += 1
            return []
        reference_s = reference_offset_s(scan.offsets_s)
        stamp_ns = scan.stamp_ns + round(reference_s * 1e9)
        if self._is_out_of_order(stamp_ns):
            self.counters.skipped_out_of_order += 1
            return []
        valid = scan.valid
        raw = self.mount.to_body(scan.angles_rad[valid], scan.ranges_m[valid])
        offsets = scan.offsets_s[valid]
        guess, twist, from_wheels = self._predict(scan, stamp_ns)
        points = deskew(raw, offsets, reference_s, twist)
        if self._settings.wheels_only:
            known = from_wheels or not self._stamps
            match = ScanMatch(guess, se2.IDENTITY, accepted=known, reason="" if known else "no wheel odometry")
            self._finish_scan(stamp_ns, match, points, from_wheels=from_wheels)
            return [MappedScan(stamp_ns, match, from_wheels)]
        match = self._odometry.match(points, guess)
        if self._stamps and match.accepted:
            twist = self._twist_to(match.pose, stamp_ns)
            points = deskew(raw, offsets, reference_s, twist)
            match = self._odometry.match(points, match.pose)
        self._finish_scan(stamp_ns, match, points, from_wheels=from_wheels)
        return [MappedScan(stamp_ns, match, from_wheels)]

    def _waits_for_a_whole_turn(self) -> bool:
        """Whether to begin with the next scan: the first is the map's frame, and a lidar's first turn begins anywhere.

        A lidar that gives no whole turns is mapped all the same.
        """
        return not self._stamps and self.counters.skipped_partial == 0

    def _is_out_of_order(self, stamp_ns: int) -> bool:
        """Whether a scan is older than the last pose; after a few of them it was that pose's stamp that was wrong."""
        if not self._stamps or stamp_ns > self._stamps[-1]:
            self._behind = 0
            return False
        self._behind += 1
        if self._behind < _SCANS_TO_STEP_BACK:
            return True
        wrong = len(self._stamps) - int(np.searchsorted(self._stamps, stamp_ns))
        if wrong > _MOST_WRONG_STAMPS:
            return True  # the clock stepped back: wait until it has caught up
        del self._stamps[-wrong:], self._poses[-wrong:]
        self.counters.mapped -= wrong
        self.counters.skipped_out_of_order += wrong
        self._behind, self._twist = 0, np.zeros(3)
        return False

    def _predict(self, scan: LaserScan, stamp_ns: int) -> tuple[FloatArray, FloatArray, bool]:
        """Return guessed pose, twist during the scan, and whether wheel odometry gave them."""
        first_ns = scan.stamp_ns
        last_ns = scan.stamp_ns + round(float(scan.offsets_s.max(initial=0.0)) * 1e9)
        if not self._stamps:
            return se2.IDENTITY, np.zeros(3), False
        previous_ns, previous = self._stamps[-1], self._poses[-1]
        if self._wheels.covers(min(previous_ns, first_ns), last_ns):
            guess = se2.compose(previous, self._wheels.motion(previous_ns, stamp_ns))
            sweep_s = (last_ns - first_ns) * 1e-9
            twist = se2.log(self._wheels.motion(first_ns, last_ns)) / sweep_s if sweep_s > 0 else np.zeros(3)
            return guess, twist, True
        left_s = _LONGEST_EXTRAPOLATION_S - (previous_ns - self._matched_ns) * 1e-9
        elapsed_s = min((stamp_ns - previous_ns) * 1e-9, max(left_s, 0.0))
        return se2.compose(previous, se2.exp(self._twist * elapsed_s)), self._twist, False

    def _twist_to(self, pose: FloatArray, stamp_ns: int) -> FloatArray:
        """Return the mean twist (3,) from the last pose of the trajectory to this one."""
        elapsed_s = (stamp_ns - self._stamps[-1]) * 1e-9
        return se2.log(se2.between(self._poses[-1], pose)) / elapsed_s

    def _finish_scan(self, stamp_ns: int, match: ScanMatch, points: FloatArray, *, from_wheels: bool) -> None:
        """Enter the scan into trajectory, local map and grid."""
        if self._stamps and match.accepted:
            self._twist = self._twist_to(match.pose, stamp_ns)
        self._stamps.append(stamp_ns)
        self._poses.append(match.pose)
        self.counters.wheel_guesses += from_wheels
        if not match.accepted:
            self.counters.unmatched += 1
            return
        self.counters.mapped += 1
        self._matched_ns = stamp_ns
        self._odometry.learn(points, match.pose)
        sensor = se2.transform_points(match.pose, self.mount.pose[:2])
        self._builder.add_scan(sensor, se2.transform_points(match.pose, points))


def _seen_sectors(scan: LaserScan) -> int:
    """Return the number of sectors of the circle in which a scan has samples, measurements or not."""
    sectors = np.floor(scan.angles_rad / (2.0 * np.pi) * _SECTORS).astype(np.int64) % _SECTORS
    return len(np.unique(sectors))
