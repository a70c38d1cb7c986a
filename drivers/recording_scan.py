"""A laser scan on constant bins, the form that sensor_msgs/LaserScan can carry.

Our scans hold samples with uneven angles and individual times; the ROS message has one start angle, one angle step and
one time step. The bins keep the order of acquisition: a clockwise sensor gets a NEGATIVE angle step and a positive time
step (angle_min > angle_max), because every consumer takes the time of ray i to be stamp + i * time_increment. Reversing
the array and keeping a positive time step, as some drivers do, gives every ray the time of its mirror image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.messages import FloatArray, LaserScan

BIN_COUNTS = (180, 240, 360, 400, 500, 600, 720, 800, 1000, 1200, 1440, 1600, 2000, 2400, 3200, 3600)
_START_GRID_RAD = math.radians(10)
_EVEN_RAD, _EVEN_S = 1e-6, 1e-7
_LONGEST_SWEEP_S = 1.0  # no planar laser turns more slowly


@dataclass(frozen=True, slots=True, eq=False)
class BinnedScan:
    """A full turn of N rays, half open (no ray twice): ray i at start_rad + i * step_rad, at stamp_ns + i * step_s.

    ranges_m and intensities are (N,); +inf is "no return" (REP-117). intensities is None where not measured.
    """

    stamp_ns: int
    start_rad: float
    step_rad: float
    step_s: float
    ranges_m: FloatArray
    intensities: FloatArray | None


def bin_count(scan: LaserScan) -> int:
    """Return how many bins a turn of this scan needs: the entry of BIN_COUNTS nearest in ratio to its own resolution.

    The resolution is the median step between neighbouring samples, so that a partial turn gets the bins of a whole one.
    SLAM tools want one count per stream: ask for the first scan, then keep the answer.
    """
    steps = np.abs(_angle_steps(scan.angles_rad))
    step = float(np.median(steps)) if steps.size else 0.0
    wanted = 2 * math.pi / step if step > 0 else BIN_COUNTS[0]
    return min(BIN_COUNTS, key=lambda count: abs(math.log(count / wanted)))


def bin_scan(scan: LaserScan, bins: int) -> BinnedScan:
    """Put a scan on `bins` rays around the full turn, the nearest return of each bin; empty bins are +inf.

    The first ray is the first sample's direction to the nearest 10 deg, so it stays put while turns start a little
    earlier or later. The stamp is the time at which the beam passed it; samples more than half a turn off
    that timetable belong to another turn and are left out.
    """
    steps = _angle_steps(scan.angles_rad)
    turning = 1.0 if steps.size and np.median(steps) > 0 else -1.0
    width = 2 * math.pi / bins
    first = float(scan.angles_rad[0]) if scan.angles_rad.size else 0.0
    start = round(first / _START_GRID_RAD) * _START_GRID_RAD
    step_s = _seconds_per_radian(scan, steps) * width

    index = np.round(turning * (scan.angles_rad - start) / width).astype(np.int64) % bins
    lag_s = scan.offsets_s - index * step_s
    start_s = float(np.median(lag_s)) if lag_s.size else 0.0
    keep = scan.valid & (np.abs(lag_s - start_s) <= bins * step_s / 2)

    ranges = np.full(bins, np.inf)
    order = np.flatnonzero(keep)
    order = order[np.argsort(-scan.ranges_m[order], kind="stable")]  # the nearest is written last
    ranges[index[order]] = scan.ranges_m[order]
    intensities = None
    if scan.intensities is not None:
        intensities = np.zeros(bins)
        intensities[index[order]] = scan.intensities[order]
    stamp_ns = scan.stamp_ns + round(start_s * 1e9)
    return BinnedScan(stamp_ns, start, turning * width, step_s, ranges, intensities)


def even_scan(scan: LaserScan) -> BinnedScan | None:
    """Return the rays of a scan as they are, if their angles and times have constant steps; else None.

    So nothing is lost of scans that came as ranges at constant steps, a part of a turn among them.
    """
    count = scan.ranges_m.size
    if count < 2:
        return None
    places = np.arange(count)
    step_rad = float(scan.angles_rad[-1] - scan.angles_rad[0]) / (count - 1)
    step_s = float(scan.offsets_s[-1]) / (count - 1)
    off_rad = np.abs(scan.angles_rad - (scan.angles_rad[0] + places * step_rad)).max()
    off_s = np.abs(scan.offsets_s - places * step_s).max()
    if not (step_rad and step_s >= 0 and off_rad <= _EVEN_RAD and off_s <= _EVEN_S):
        return None
    return BinnedScan(scan.stamp_ns, float(scan.angles_rad[0]), step_rad, step_s, scan.ranges_m, scan.intensities)


def unbin_scan(
    binned: BinnedScan, *, range_min_m: float, range_max_m: float, frame_id: str, scan_time_s: float = 0.0
) -> LaserScan:
    """Return the samples of a ROS scan in the order of time, every ray kept, stamp at the first one taken.

    A negative step_s says that the stamp is that of the LAST ray taken (an array in reverse order): stamp and order are
    turned round. Times that cannot be (NaN, a negative scan_time_s, a sweep of more than a second) become offsets of 0.
    """
    rays = np.arange(binned.ranges_m.size, dtype=np.float64)
    angles = binned.start_rad + rays * binned.step_rad
    step_s, stamp_ns = binned.step_s, binned.stamp_ns
    sweep_s = abs(step_s) * rays.size
    if not (math.isfinite(sweep_s) and sweep_s <= _LONGEST_SWEEP_S and scan_time_s >= 0):
        step_s = 0.0
    offsets = rays * abs(step_s)
    order = slice(None)
    if step_s < 0:
        stamp_ns -= round(float(offsets[-1]) * 1e9) if rays.size else 0
        order = slice(None, None, -1)
    same_length = binned.intensities is not None and binned.intensities.size == rays.size
    return LaserScan(
        stamp_ns=stamp_ns,
        angles_rad=angles[order],
        ranges_m=binned.ranges_m[order],
        offsets_s=offsets,
        range_min_m=range_min_m,
        range_max_m=range_max_m,
        frame_id=frame_id,
        intensities=binned.intensities[order] if same_length and binned.intensities is not None else None,
    )


def _angle_steps(angles_rad: FloatArray) -> FloatArray:
    """Return the (N - 1,) turns from sample to sample, each the short way round."""
    steps: FloatArray = (np.diff(angles_rad) + math.pi) % (2 * math.pi) - math.pi
    return steps


def _seconds_per_radian(scan: LaserScan, steps: FloatArray) -> float:
    """Return how long the beam takes for one radian; 0 where the offsets do not tell."""
    turned = abs(float(steps.sum()))
    if turned < math.radians(1):
        return 0.0
    return max(0.0, float(scan.offsets_s[-1] - scan.offsets_s[0]) / turned)
