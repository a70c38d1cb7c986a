from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import LaserScan
from mapping.hidden_sectors import HiddenSector, hide_sectors
from mapping.mount import Mount

ANGLES = np.linspace(-np.pi, np.pi, 720, endpoint=False)
SCAN = LaserScan(0, ANGLES, np.full(720, 2.0), np.zeros(720), 0.15, 12.0)


def hidden_bearings(sector: HiddenSector, mount: Mount) -> np.ndarray:
    """Where on the body what is left out would have been drawn, as seen from the laser."""
    hidden = hide_sectors(SCAN, [sector], mount).ranges_m == 0.0
    points = mount.to_body(ANGLES[hidden], np.ones(hidden.sum())) - mount.pose[:2]
    return np.sort(np.arctan2(points[:, 1], points[:, 0]))


@pytest.mark.parametrize("yaw", [0.0, 1.0, np.pi])
@pytest.mark.parametrize("inverted", [False, True])
def test_the_sector_is_where_the_body_is_however_the_laser_is_mounted(yaw: float, inverted: bool) -> None:
    mount = Mount(np.array([0.1, 0.2, yaw]), inverted)
    bearings = hidden_bearings(HiddenSector(0.5, 1.5), mount)
    assert (bearings.min(), bearings.max()) == pytest.approx((0.5, 1.5), abs=0.01)
    assert len(bearings) == pytest.approx(720 / (2 * np.pi), abs=2)


def test_a_sector_may_cross_the_back() -> None:
    bearings = hidden_bearings(HiddenSector(3.0, -3.0), Mount())
    assert np.all(np.abs(bearings) > 2.99)
    assert len(bearings) == pytest.approx(720 * (2 * np.pi - 6.0) / (2 * np.pi), abs=2)


def test_only_what_is_near_is_hidden() -> None:
    ranges = np.where(np.arange(720) % 2, 0.2, 2.0)
    scan = LaserScan(0, ANGLES, ranges, np.zeros(720), 0.15, 12.0)
    left = hide_sectors(scan, [HiddenSector(-3.2, 3.2, 0.3)], Mount())
    assert set(left.ranges_m[::2]) == {2.0}
    kept = hide_sectors(scan, [HiddenSector(-3.0, 3.0, 0.3), HiddenSector(3.0, -3.0, 0.3)], Mount())
    assert set(kept.ranges_m) == {0.0, 2.0}


def test_without_sectors_the_scan_is_itself() -> None:
    assert hide_sectors(SCAN, [], Mount()) is SCAN
