from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.messages import LaserScan
from drivers.recording_scan import BIN_COUNTS, BinnedScan, bin_count, bin_scan, even_scan, unbin_scan


def turn(samples=800, first_deg=-0.2, clockwise=True, period_s=0.1, ranges=None, span_deg=360.0, **fields):
    """A turn of evenly spaced samples, clockwise as the RPLIDAR takes them."""
    sign = -1 if clockwise else 1
    angles = math.radians(first_deg) + sign * np.arange(samples) * math.radians(span_deg) / samples
    return LaserScan(
        stamp_ns=5_000_000_000,
        angles_rad=(angles + math.pi) % (2 * math.pi) - math.pi,
        ranges_m=np.full(samples, 2.0) if ranges is None else ranges,
        offsets_s=np.arange(samples) * period_s * (span_deg / 360) / samples,
        range_min_m=0.15,
        range_max_m=12.0,
        **fields,
    )


def unbinned(binned, **fields):
    return unbin_scan(binned, range_min_m=0.15, range_max_m=12.0, frame_id="laser", **fields)


@pytest.mark.parametrize(
    ("samples", "bins"), [(360, 360), (797, 800), (805, 800), (722, 720), (1597, 1600), (20, 180), (9000, 3600)]
)
def test_a_stream_gets_the_bin_count_nearest_to_its_resolution(samples, bins):
    assert bin_count(turn(samples)) == bins


def test_a_partial_turn_gets_the_bins_of_a_whole_one():
    assert bin_count(turn(200, span_deg=90)) == 800


def test_a_scan_without_samples_is_all_no_return():
    empty = turn(0)

    binned = bin_scan(empty, bin_count(empty))

    assert np.isposinf(binned.ranges_m).all()
    assert len(binned.ranges_m) == BIN_COUNTS[0]


@pytest.mark.parametrize("clockwise", [True, False])
def test_rays_keep_the_order_of_acquisition(clockwise):
    binned = bin_scan(turn(clockwise=clockwise), 800)

    assert binned.step_rad == pytest.approx(math.copysign(2 * math.pi / 800, -1 if clockwise else 1))
    assert binned.step_s == pytest.approx(0.1 / 800, rel=1e-3)
    assert binned.start_rad == 0.0
    assert np.isfinite(binned.ranges_m).all()


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("first_deg", [-0.4, 0.3, 90.1, -179.9, 37.0])
def test_direction_time_and_range_of_every_ray_survive(clockwise, first_deg):
    ranges = 1 + np.arange(800) / 100  # a spiral: each range tells which sample it was
    scan = turn(first_deg=first_deg, clockwise=clockwise, ranges=ranges)

    back = unbinned(bin_scan(scan, 800))

    shift_s = (back.stamp_ns - scan.stamp_ns) * 1e-9
    kept = back.valid
    assert kept.sum() > 785  # those past a full turn from the first ray are left out
    sample = np.round((back.ranges_m[kept] - 1) * 100).astype(int)
    miss = np.angle(np.exp(1j * (back.angles_rad[kept] - scan.angles_rad[sample])))
    assert np.abs(miss).max() <= math.radians(360 / 800) * 0.51
    assert back.offsets_s[kept] + shift_s == pytest.approx(scan.offsets_s[sample], abs=2e-4)


def test_the_nearest_return_wins_and_no_measurement_becomes_infinite():
    ranges = np.full(800, 3.0)
    ranges[[10, 11]] = 1.0, 0.0
    ranges[[20, 21]] = 12.0, math.nan
    scan = turn(first_deg=0.2, ranges=ranges, intensities=ranges * 10)  # samples 2 i and 2 i + 1 fall into bin i

    binned = bin_scan(scan, 400)

    assert binned.ranges_m[5] == 1.0
    assert binned.intensities is not None
    assert binned.intensities[5] == 10.0
    assert np.isposinf(binned.ranges_m[10])
    assert binned.intensities[10] == 0.0


def test_without_times_there_is_no_time_step():
    scan = turn()
    untimed = LaserScan(scan.stamp_ns, scan.angles_rad, scan.ranges_m, np.zeros(800), 0.15, 12.0)

    binned = bin_scan(untimed, 800)

    assert binned.step_s == 0.0
    assert binned.stamp_ns == scan.stamp_ns
    assert np.isfinite(binned.ranges_m).all()


def test_a_negative_time_step_says_that_the_stamp_is_the_last_ray():
    binned = BinnedScan(1_000_000_000, -1.0, 0.5, -0.01, np.array([1.0, 2.0, 3.0]), np.array([7.0, 8.0, 9.0]))

    scan = unbinned(binned)

    assert scan.stamp_ns == 980_000_000
    assert scan.ranges_m.tolist() == [3.0, 2.0, 1.0]
    assert scan.angles_rad.tolist() == [0.0, -0.5, -1.0]
    assert scan.offsets_s == pytest.approx([0.0, 0.01, 0.02])
    assert scan.intensities is not None
    assert scan.intensities.tolist() == [9.0, 8.0, 7.0]


@pytest.mark.parametrize(
    ("step_s", "scan_time_s"), [(math.nan, 0.1), (math.inf, 0.1), (0.001, -0.1), (0.001, math.nan), (100.0, 0.1)]
)
def test_times_that_cannot_be_are_dropped(step_s, scan_time_s):
    binned = BinnedScan(1_000_000_000, -1.0, 0.5, step_s, np.array([1.0, 2.0, 3.0]), None)

    scan = unbinned(binned, scan_time_s=scan_time_s)

    assert scan.stamp_ns == 1_000_000_000
    assert scan.offsets_s.tolist() == [0.0, 0.0, 0.0]


def test_intensities_of_another_length_are_dropped():
    assert unbinned(BinnedScan(0, 0.0, 0.1, 0.0, np.ones(3), np.ones(2))).intensities is None


@given(
    st.lists(st.tuples(st.floats(-7, 7), st.floats(0, 20), st.floats(0, 0.2)), max_size=40),
    st.sampled_from(BIN_COUNTS),
)
def test_no_return_is_invented(samples, bins):
    angles, ranges, offsets = (
        (np.array(column, dtype=float) for column in zip(*samples, strict=True)) if samples else (np.zeros(0),) * 3
    )
    scan = LaserScan(0, angles, ranges, np.sort(offsets), 0.15, 12.0)

    back = unbinned(bin_scan(scan, bins))

    assert len(back.ranges_m) == bins
    assert set(back.ranges_m[back.valid]) <= set(scan.ranges_m[scan.valid])


@pytest.mark.parametrize("clockwise", [True, False])
@pytest.mark.parametrize("period_s", [0.0, 0.1])
def test_a_part_of_a_turn_at_constant_steps_survives_as_it_is(clockwise, period_s):
    ranges = np.linspace(0.5, 90.0, 682)
    scan = turn(682, -119.5 if not clockwise else 119.5, clockwise, period_s, ranges, span_deg=238, intensities=ranges)
    rays = even_scan(scan)
    assert rays is not None
    back = unbinned(rays)
    assert back.stamp_ns == scan.stamp_ns
    assert back.angles_rad == pytest.approx(scan.angles_rad, abs=1e-9)
    assert back.offsets_s == pytest.approx(scan.offsets_s, abs=1e-12)
    assert back.ranges_m.tolist() == ranges.tolist()
    assert back.intensities.tolist() == ranges.tolist()


@pytest.mark.parametrize("name", ["angles_rad", "offsets_s"])
def test_uneven_scans_have_no_constant_steps(name):
    scan = turn(100, span_deg=90)
    values = getattr(scan, name).copy()
    values[50] += 1e-4
    assert even_scan(scan) is not None
    assert even_scan(replace(scan, **{name: values})) is None


def test_a_scan_of_one_sample_or_none_has_no_step():
    assert even_scan(turn(1)) is None
    assert even_scan(turn(0)) is None
