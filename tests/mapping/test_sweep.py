from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import LaserScan
from mapping.grid import OccupancyGrid
from mapping.mount import Mount
from mapping.slam import MappingSettings
from mapping.sweep import detect_sweep, entropy, reverse_sweep

TURNING = ((3.0, (0.2, 0.0, 0.8)), (2.0, (0.2, 0.0, -0.8)))  # 4 rad in all


def misstated(scan: LaserScan) -> LaserScan:
    """The scan from a driver that sorts the samples by rising angle and keeps the times in their old order."""
    return replace(scan, angles_rad=scan.angles_rad[::-1], ranges_m=scan.ranges_m[::-1])


@pytest.mark.parametrize("mount", [Mount(), Mount(np.array([-0.04, 0.0, np.pi / 2]))], ids=["centred", "sideways"])
def test_reversed_scans_of_a_turning_robot_are_recognised(mount: Mount, simulate_drive: Callable) -> None:
    drive = simulate_drive(TURNING, mount=mount)
    verdict = detect_sweep([misstated(scan) for scan in drive.scans], MappingSettings(), mount)
    assert verdict.is_reversed, verdict.reason
    assert "sharper" in verdict.reason


def test_rightly_stated_scans_of_a_turning_robot_are_kept(simulate_drive: Callable) -> None:
    verdict = detect_sweep(simulate_drive(TURNING).scans, MappingSettings(), Mount())
    assert not verdict.is_reversed, verdict.reason
    assert "less sharp" in verdict.reason


@pytest.mark.parametrize("twist", [(0.0, 0.0, 0.0), (0.4, 0.0, 0.0)], ids=["standing", "straight on"])
def test_a_robot_that_does_not_turn_is_taken_at_its_word(
    twist: tuple[float, float, float], simulate_drive: Callable
) -> None:
    drive = simulate_drive([(3.0, twist)])
    for scans in (drive.scans, [misstated(scan) for scan in drive.scans]):
        verdict = detect_sweep(scans, MappingSettings(), Mount())
        assert not verdict.is_reversed
        assert "too little to tell" in verdict.reason


def test_scans_without_times_have_no_sweep(winding) -> None:
    scans = [replace(scan, offsets_s=np.zeros(400)) for scan in winding.scans[:3]]
    for given in (scans, []):
        verdict = detect_sweep(given, MappingSettings(), Mount())
        assert not verdict.is_reversed
        assert "no times" in verdict.reason


def test_reversing_gives_each_sample_the_opposite_time_and_is_its_own_inverse(winding) -> None:
    scan = replace(winding.scans[0], intensities=np.arange(400.0))
    turned = reverse_sweep(scan)
    assert turned.stamp_ns == scan.stamp_ns
    assert (np.diff(turned.offsets_s) >= 0.0).all()
    time_of = dict(zip(turned.angles_rad.tolist(), turned.offsets_s.tolist(), strict=True))
    last_s = scan.offsets_s[-1]
    assert [time_of[angle] for angle in scan.angles_rad.tolist()] == pytest.approx((last_s - scan.offsets_s).tolist())
    again = reverse_sweep(turned)
    np.testing.assert_array_equal(again.ranges_m, scan.ranges_m)
    np.testing.assert_array_equal(again.intensities, scan.intensities)
    np.testing.assert_allclose(again.offsets_s, scan.offsets_s, atol=1e-15)


def test_reversing_an_empty_scan_is_an_empty_scan(winding) -> None:
    nothing = np.zeros(0)
    scan = replace(winding.scans[0], angles_rad=nothing, ranges_m=nothing, offsets_s=nothing)
    assert reverse_sweep(scan).ranges_m.shape == (0,)


def test_entropy_is_that_of_the_known_cells() -> None:
    def of(*cells: float) -> float:
        return entropy(OccupancyGrid(np.array([cells], dtype=np.float32), 0.05, np.zeros(3)))

    assert of(0.0, 0.0) == 0.0
    assert of(1e-6) == pytest.approx(np.log(2.0))
    assert of(1e-6, 1e-6, 0.0) == pytest.approx(2.0 * np.log(2.0))
    assert of(7.0) == pytest.approx(of(-7.0), rel=1e-3)  # near 1 a float32 probability has four digits left of 1 - p
    assert of(7.0) < of(3.0) < of(0.5)
