from __future__ import annotations

import numpy as np
import pytest

from mapping.depth_bins import count_ranges, floor_ends, nearest_ranges

STRAIGHT = np.array([0.0, 0.0, 1.0, 0.0])
FAN = np.array([-1.0, 5.0])  # ten beams from tangent -1 to 1
BAND = np.array([0.1, 0.02, 1.2])


def counted(points, place=STRAIGHT):
    counts, sums, floor = np.zeros((10, 60), np.int32), np.zeros((10, 60)), np.zeros((10, 24), np.int32)
    bin_of_mm = (np.arange(6000) // 100).astype(np.int32)
    count_ranges(np.array(points, float).reshape(-1, 3), place, FAN, BAND, bin_of_mm, 0.25, counts, sums, floor)
    return counts, sums, floor


def test_points_fall_into_beam_and_bin():
    counts, sums, floor = counted([[2.05, 0.2, 0.5], [2.05, -2.0, 0.5]])
    assert np.argwhere(counts).tolist() == [[0, 28], [5, 20]]  # hypot(2.05, 2) = 2.86 m
    assert sums[5, 20] == pytest.approx(np.hypot(2.05, 0.2))
    assert not floor.any()


@pytest.mark.parametrize(
    ("height", "obstacles", "floors"),
    [(1.21, 0, 0), (1.19, 1, 0), (0.15, 1, 0), (0.13, 0, 1), (0.0, 0, 1), (-0.13, 0, 1), (-0.15, 0, 0)],
)
def test_heights_tell_obstacles_from_floor_drops_and_what_hangs_above(height, obstacles, floors):
    counts, _, floor = counted([[2.0, 0.0, height]])  # the band begins at 0.1 + 0.04 m here
    assert (counts.sum(), floor.sum()) == (obstacles, floors)


def test_what_lies_beside_or_behind_or_too_far_is_not_counted():
    counts, _, floor = counted([[1.0, 1.1, 0.5], [-1.0, 0.0, 0.5], [6.5, 0.0, 0.5], [7.0, 0.0, 0.0]])
    assert not counts.any()
    assert not floor.any()


def test_camera_that_looks_to_the_left_counts_from_its_own_place():
    counts, _, _ = counted([[0.9, 2.5, 0.5]], np.array([1.0, 0.5, 0.0, 1.0]))  # 2 m before it, 0.1 m to its left
    assert np.argwhere(counts).tolist() == [[5, 20]]


def ranges_of(values, support=6, width=0.1):
    """Return what nearest_ranges says of one beam with points at these ranges."""
    counts, sums = np.zeros((1, 60), np.int32), np.zeros((1, 60))
    np.add.at(counts[0], (np.array(values) / width).astype(int), 1)
    np.add.at(sums[0], (np.array(values) / width).astype(int), values)
    return nearest_ranges(counts, sums, support)[0]


def test_an_obstacle_needs_support():
    assert ranges_of([1.0] * 5) == 0.0
    assert ranges_of([1.0] * 6) == pytest.approx(1.0)
    assert ranges_of([1.0] * 5 + [3.0] * 50) == pytest.approx(3.0)
    assert ranges_of([1.0] * 6 + [3.0] * 50) == pytest.approx(1.0)
    assert ranges_of([1.08] * 3 + [1.12] * 3) == pytest.approx(1.1)  # also across a border between bins


def test_range_of_a_noisy_wall_is_its_middle_not_its_nearest_tail():
    random = np.random.default_rng(0)
    found = [ranges_of(random.normal(3.0, 0.1, 150)) for _ in range(50)]
    assert np.mean(found) == pytest.approx(3.0, abs=0.03)


def ends_of(*ranges_m):
    floor = np.zeros((1, 24), np.int32)
    for range_m in ranges_m:
        floor[0, int(range_m / 0.25)] += 2
    return floor_ends(floor, 0.25, 0.3, 0.05)[0]


def test_floor_goes_on_until_a_gap():
    assert ends_of() == 0.0
    assert ends_of(0.6, 0.8, 1.1, 1.4) == pytest.approx(1.375)
    assert ends_of(0.6, 0.8, 2.1, 2.4) == pytest.approx(0.875)
    assert ends_of(3.1, 4.1) == pytest.approx(4.125)  # rows lie farther apart there
    assert ends_of(2.4) == pytest.approx(2.375)  # near the car the camera sees no floor


def test_one_pixel_is_no_floor():
    floor = np.zeros((1, 24), np.int32)
    floor[0, 3] = 1
    assert floor_ends(floor, 0.25, 0.3, 0.05)[0] == 0.0
