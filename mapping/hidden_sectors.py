"""Sectors in which a laser sees the car that carries it: what is measured there is left out, neither wall nor free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.messages import LaserScan
from mapping.mount import Mount

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class HiddenSector:
    """Directions on the body as seen from the laser, counter-clockwise from one to the other, 0 = ahead, in rad.

    nearer_than_m: only returns below this range are hidden.
    """

    from_rad: float
    to_rad: float
    nearer_than_m: float = math.inf


def hide_sectors(scan: LaserScan, sectors: Sequence[HiddenSector], mount: Mount) -> LaserScan:
    """Return the scan with range 0, no measurement, in the sectors."""
    if not sectors:
        return scan
    side = -1.0 if mount.inverted else 1.0
    bearings = mount.pose[2] + side * scan.angles_rad
    hidden = np.zeros(len(bearings), dtype=np.bool_)
    for sector in sectors:
        width = (sector.to_rad - sector.from_rad) % _TURN
        inside = (bearings - sector.from_rad) % _TURN <= width
        hidden |= inside & (scan.ranges_m < sector.nearer_than_m)
    return replace(scan, ranges_m=np.where(hidden, 0.0, scan.ranges_m))
