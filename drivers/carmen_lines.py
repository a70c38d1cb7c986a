"""One line of a CARMEN log: laser scans in the old and the new form, and odometry.

A line is a name, its content, IPC time stamp, host, logger time stamp. FLASER (old) has the number of readings, the
readings in m, laser pose, robot odometry. ROBOTLASER1 and RAWLASER1 (new) say first what the laser is like: type, start
angle, field of view, angular resolution, maximum range, accuracy, remission mode; then come the readings, their
remissions and, in ROBOTLASER1, laser pose, robot odometry, its velocities and three numbers of the robot. Source: the
format comment at the head of the logs themselves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from drivers.messages import FloatArray, LaserScan, Odometry

LASER_FRAME = "laser"
FIELD_OF_VIEW_RAD = math.pi  # of a SICK scanner, which nearly all FLASER lines are of
NO_RETURN_M = 81.0  # and more: SICK's "no return"
RANGE_MAX_M = 80.0
SCAN_NAMES = ("ROBOTLASER1", "FLASER", "RAWLASER1")  # what says more comes first
_SICK_HALF_TURN_COUNTS = (180, 181, 360, 361)
_SICK_100_DEG_COUNTS = (101, 201, 401)  # the LMS's other mode: 100 deg in steps of 1, 0.5 and 0.25 deg
_HEADER_FIELDS, _POSE_FIELDS, _STAMP_FIELDS = 7, 11, 3
_FEWEST_WITHOUT_RETURN = 20
_MOST_BEYOND = 1e-3
_NARROW_SHARE = 0.8
_BINS = 8200  # of 1 cm
_LATEST_S = 10**9 * 9  # what 64 bits of ns can count
_FULL_TURN_WITH_SLACK = 6.3


@dataclass(frozen=True, slots=True, eq=False)
class LaserLine:
    """A scan as its line says it, lengths in m, angles in rad.

    ranges_m (N,), intensities (N,) or None. beams: (start, field of view, resolution) where the line tells, and
    range_max_m the stated maximum (inf where it tells none). laser_pose and robot_pose (3,) and velocity (forward,
    turning) are None where the line has none.
    """

    stamp_ns: int
    ranges_m: FloatArray
    beams: tuple[float, float, float] | None = None
    range_max_m: float = math.inf
    intensities: FloatArray | None = None
    laser_pose: FloatArray | None = None
    robot_pose: FloatArray | None = None
    velocity: tuple[float, float] = (0.0, 0.0)

    def odometry(self) -> Odometry | None:
        """Return where the robot was by its wheels when it took the scan."""
        if self.robot_pose is None:
            return None
        forward, turn = self.velocity
        return Odometry(self.stamp_ns, self.robot_pose, np.array([forward, 0.0, turn]))

    def laser_on_robot(self) -> FloatArray | None:
        """Return the pose (3,) of the laser as the robot sees it, from the line's two poses."""
        if self.laser_pose is None or self.robot_pose is None:
            return None
        dx, dy, turn = (self.laser_pose - self.robot_pose).tolist()
        cos, sin = math.cos(self.robot_pose[2]), math.sin(self.robot_pose[2])
        turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
        return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, turn])

    def scan(self, range_max_m: float, stated: StatedLaser) -> LaserScan:
        """Return the scan; readings of range_max_m and more are none, nor those beyond the line's own maximum."""
        count = len(self.ranges_m)
        angles = beam_angles(count, stated) if self.beams is None else stated_angles(count, *self.beams)
        limit = min(range_max_m, self.range_max_m)
        return LaserScan(
            stamp_ns=self.stamp_ns,
            angles_rad=angles,
            ranges_m=np.where(self.ranges_m >= limit, np.inf, self.ranges_m),
            offsets_s=np.zeros(count),
            range_min_m=0.0,
            range_max_m=limit,
            frame_id=LASER_FRAME,
            intensities=self.intensities,
        )


@dataclass(frozen=True, slots=True)
class StatedLaser:
    """What a log's PARAM lines say of its front laser: rad and m; NaN for what they do not tell."""

    field_of_view_rad: float = math.nan
    resolution_rad: float = math.nan
    ahead_m: float = math.nan


def parse_parameters(values: dict[str, str]) -> StatedLaser:
    """Return what the parameters {name: value} of a log say of its front laser."""

    def number(name: str) -> float:
        try:
            return float(values.get(name, "nan"))
        except ValueError:
            return math.nan

    field_of_view = number("laser_front_laser_fov")
    if field_of_view > _FULL_TURN_WITH_SLACK:
        field_of_view = math.radians(field_of_view)
    resolution = math.radians(number("laser_front_laser_resolution"))
    return StatedLaser(field_of_view, resolution, number("robot_frontlaser_offset"))


def beam_angles(count: int, stated: StatedLaser | None = None) -> FloatArray:
    """Return the directions (count,) in rad, rising, of the beams of a line that does not tell them.

    The usual numbers are SICK's: 181 and 361 beams have one at either end of 180 deg, 180 and 360 lack the last, 101,
    201 and 401 have one at either end of 100 deg. For other numbers the log's parameters are asked; where they are
    silent 180 deg are assumed, to which an even number lacks the last beam.
    """
    if count in _SICK_100_DEG_COUNTS:
        half = math.radians(50.0)
        return np.linspace(-half, half, count)
    if stated is not None and count not in _SICK_HALF_TURN_COUNTS:
        field, resolution = stated.field_of_view_rad, stated.resolution_rad
        if field > 0.0:
            return stated_angles(count, -field / 2.0, field, resolution)
        if resolution > 0.0 and resolution * (count - 1) < 2.0 * math.pi:
            return np.asarray((np.arange(count) - (count - 1) / 2.0) * resolution)
    intervals = count - 1 if count % 2 else count
    step = FIELD_OF_VIEW_RAD / max(intervals, 1)
    return np.asarray(np.arange(count) * step - FIELD_OF_VIEW_RAD / 2.0, dtype=np.float64)


def stated_angles(count: int, start_rad: float, field_of_view_rad: float, resolution_rad: float) -> FloatArray:
    """Return the directions (count,) in rad of beams that their log tells.

    The resolution is the step where it leads from the start to the end of the field of view, within one step and a
    half; else the two ends are believed.
    """
    steps = np.arange(count, dtype=np.float64)
    spanned = resolution_rad * (count - 1)
    agrees = resolution_rad > 0.0 and abs(spanned - field_of_view_rad) <= 1.5 * resolution_rad
    step = resolution_rad if agrees or not field_of_view_rad > 0.0 else field_of_view_rad / max(count - 1, 1)
    return np.asarray(start_rad + steps * step, dtype=np.float64)


def parse_laser(name: str, fields: list[bytes]) -> LaserLine:
    """Return the scan of a line without its name; raises ValueError for one that is not whole."""
    if name == "FLASER":
        return _parse_old(fields)
    return _parse_new(fields, has_poses=name == "ROBOTLASER1")


def parse_odometry(fields: list[bytes]) -> Odometry:
    """Return the odometry of an ODOM line without its name; raises ValueError for one that is not whole."""
    if len(fields) != 9:
        raise ValueError(f"{len(fields)} fields, 9 expected")
    x, y, yaw, forward, turn = (float(field) for field in fields[:5])
    if not all(map(math.isfinite, (x, y, yaw, forward, turn))):
        raise ValueError("not finite")
    return Odometry(parse_stamp_ns(fields[6]), np.array([x, y, yaw]), np.array([forward, 0.0, turn]))


def parse_stamp_ns(text: bytes) -> int:
    """Return decimal seconds as ns, exactly: relations name their scans by these digits. Raises ValueError."""
    if b"e" in text.lower():
        try:
            seconds = Decimal(text.decode("ascii"))
        except InvalidOperation as error:
            raise ValueError(f"invalid stamp {text!r}") from error
        if not -_LATEST_S < seconds < _LATEST_S:  # abs() would overflow
            raise ValueError(f"invalid stamp {text!r}")
        return round(seconds * 1_000_000_000)
    whole, _, fraction = text.partition(b".")
    return int(whole) * 1_000_000_000 + int((fraction + b"000000000")[:9])


def count_readings(histogram: NDArray[np.int64], ranges_m: FloatArray) -> None:
    """Add readings (N,) to a histogram (8200,) in steps of 1 cm; see no_return_limit."""
    centimetres = np.clip(np.nan_to_num(ranges_m * 100.0, posinf=0.0), 0, _BINS - 1)
    histogram += np.bincount(centimetres.round().astype(np.intp), minlength=_BINS)


def new_histogram() -> NDArray[np.int64]:
    """Return an empty histogram for count_readings."""
    return np.zeros(_BINS, dtype=np.int64)


def no_return_limit(histogram: NDArray[np.int64]) -> float:
    """Return the reading in m from which on readings are no measurements.

    A laser that sees nothing writes one and the same large number, so that readings pile up there (the last hundredth,
    most of them within 3 cm) and are rare just before (the last tenth): 51.15 m in the Edmonton log. Where nothing
    piles up so, SICK's 81 m.
    """
    readings = histogram[1 : round(NO_RETURN_M * 100)]
    total, beyond = int(readings.sum()), 0
    for index in np.flatnonzero(readings)[::-1].tolist():
        if beyond > _MOST_BEYOND * total:
            break
        top = index + 1  # in cm
        pile_from, before_from = math.floor(0.99 * top), math.floor(0.9 * top)
        piled = histogram[pile_from : top + 1]
        pile, before = int(piled.sum()), int(histogram[before_from:pile_from].sum())
        narrow = int(np.convolve(piled, np.ones(3, dtype=np.int64)).max())
        is_steep = pile > 3 * before and narrow > _NARROW_SHARE * pile
        if pile >= _FEWEST_WITHOUT_RETURN and is_steep and pile > _MOST_BEYOND * total:
            return float(pile_from) / 100.0
        beyond += int(readings[index])
    return NO_RETURN_M


def _parse_old(fields: list[bytes]) -> LaserLine:
    count = int(fields[0]) if fields else 0
    if count < 1 or len(fields) != count + 10:
        raise ValueError(f"{len(fields)} fields for {count} readings")
    numbers = np.array(fields[1 : count + 7], dtype=np.float64)
    ranges, poses = numbers[:count], numbers[count:]
    _require_finite(poses)
    return LaserLine(parse_stamp_ns(fields[-3]), ranges, laser_pose=poses[:3], robot_pose=poses[3:])


def _parse_new(fields: list[bytes], *, has_poses: bool) -> LaserLine:
    count = int(fields[_HEADER_FIELDS]) if len(fields) > _HEADER_FIELDS else 0
    header = np.array(fields[:_HEADER_FIELDS], dtype=np.float64)
    _require_finite(header[1:5])
    first = _HEADER_FIELDS + 1
    tail = fields[first + count :]
    last = (_POSE_FIELDS if has_poses else 0) + _STAMP_FIELDS
    remissions = int(tail[0]) if len(tail) > last else -1  # early loggers wrote not even their number
    if count < 1 or len(tail) != last + remissions + 1:
        raise ValueError(f"{len(fields)} fields for {count} readings")
    ranges = np.array(fields[first : first + count], dtype=np.float64)
    intensities = np.array(tail[1 : 1 + count], dtype=np.float64) if remissions == count else None
    start, field_of_view, resolution, range_max = header[1:5].tolist()
    if field_of_view > _FULL_TURN_WITH_SLACK:  # written in degrees
        start, field_of_view, resolution = (math.radians(value) for value in (start, field_of_view, resolution))
    poses = np.array(tail[remissions + 1 : remissions + 9], dtype=np.float64) if has_poses else None
    if poses is not None:
        _require_finite(poses)
    return LaserLine(
        parse_stamp_ns(fields[-3]),
        ranges,
        beams=(start, field_of_view, resolution) if field_of_view > 0.0 or resolution > 0.0 else None,
        range_max_m=range_max if range_max > 0.0 else math.inf,
        intensities=intensities,
        laser_pose=None if poses is None else poses[:3],
        robot_pose=None if poses is None else poses[3:6],
        velocity=(0.0, 0.0) if poses is None else (float(poses[6]), float(poses[7])),
    )


def _require_finite(numbers: FloatArray) -> None:
    if not np.isfinite(numbers).all():
        raise ValueError("not finite")
