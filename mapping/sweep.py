"""Which way a laser really sweeps, where the LaserScan messages of a recording may say it wrongly.

rplidar_ros turns the samples of a clockwise sensor into rising angles and keeps a positive time_increment (see
Slamtec/rplidar_ros#55), so that the first sample by its claim is the last by the clock. While the robot turns, the
right order gives the sharper map: that decides here. Streams that this project decodes itself need none of this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.messages import LaserScan
from mapping.grid import OccupancyGrid
from mapping.mount import Mount
from mapping.slam import Mapper, MappingSettings

TRIAL_SCANS = 300
_WINDOW_SCANS = 30  # mapped on their own: over more of them drift blurs a map more than the order of samples does
LEAST_TURN_RAD = 1.0
LEAST_GAIN = 0.02


@dataclass(frozen=True, slots=True)
class SweepVerdict:
    """Whether the samples' times run against their order, and why that was decided."""

    is_reversed: bool
    reason: str


def reverse_sweep(scan: LaserScan) -> LaserScan:
    """Return the scan with its samples taken in the opposite order over the same time."""
    return replace(
        scan,
        angles_rad=scan.angles_rad[::-1],
        ranges_m=scan.ranges_m[::-1],
        offsets_s=(scan.offsets_s.max(initial=0.0) - scan.offsets_s)[::-1],
        intensities=None if scan.intensities is None else scan.intensities[::-1],
    )


def detect_sweep(scans: Sequence[LaserScan], settings: MappingSettings, mount: Mount) -> SweepVerdict:
    """Map the scans (TRIAL_SCANS are plenty) in both orders and return the order that gives the sharper map.

    The stated order stands unless the other is sharper by LEAST_GAIN, and where the robot turns too little to tell.
    """
    if not any(scan.offsets_s.any() for scan in scans):
        return SweepVerdict(is_reversed=False, reason="the scans carry no times within a turn")
    trial = replace(settings, use_wheel_odometry=False, wheels_only=False)
    stated, turn_rad = _blur(scans, trial, mount)
    if turn_rad < LEAST_TURN_RAD:
        return SweepVerdict(
            is_reversed=False, reason=f"taken as stated: {np.degrees(turn_rad):.0f} deg turned, too little to tell"
        )
    opposite, _ = _blur([reverse_sweep(scan) for scan in scans], trial, mount)
    gain = 1.0 - opposite / stated if stated > 0 else 0.0
    comparison = f"map {abs(gain):.1%} {'sharper' if gain > 0 else 'less sharp'} in the opposite order"
    return SweepVerdict(is_reversed=gain > LEAST_GAIN, reason=comparison)


def _blur(scans: Sequence[LaserScan], settings: MappingSettings, mount: Mount) -> tuple[float, float]:
    """Return the sum of the entropies of the maps of short stretches, and the angle that the robot turned meanwhile."""
    blur, turned_rad = 0.0, 0.0
    for start in range(0, len(scans), _WINDOW_SCANS):
        mapper = Mapper(settings, mount)
        for scan in scans[start : start + _WINDOW_SCANS]:
            mapper.add_scan(scan)
        mapper.finish()
        turned_rad += float(np.abs(np.diff(np.unwrap(mapper.trajectory.poses[:, 2]))).sum())
        blur += entropy(mapper.grid())
    return blur, turned_rad


def entropy(grid: OccupancyGrid) -> float:
    """Return the sum over the known cells of their binary entropy in nat: small for a sharp map."""
    p = np.clip(grid.probability[grid.known].astype(np.float64), 1e-6, 1.0 - 1e-6)
    return float(-(p * np.log(p) + (1.0 - p) * np.log(1.0 - p)).sum())
