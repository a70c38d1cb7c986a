"""The pixels of a virtual scan counted by direction and range, and what the counts say. Compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Counts = NDArray[np.int32]

_CLIMB = 4  # bins behind the first supported one among which the peak is sought: noise spreads a wall over so many


@njit(cache=True, nogil=True)
def count_ranges(
    points: FloatArray,
    place: FloatArray,
    fan: FloatArray,
    band: FloatArray,
    bin_of_mm: Counts,
    floor_bin_m: float,
    counts: Counts,
    sums: FloatArray,
    floor: Counts,
) -> None:
    """Count points (N, 3) in base_link by beam and range: obstacles in counts and sums (of ranges), the rest in floor.

    place: x, y, cosine and sine of the yaw of the camera. fan: tangent at which the first beam begins, beams a unit of
    tangent. band: lowest height of an obstacle, its rise per metre of range, greatest height. bin_of_mm: bin of a
    range in whole mm. counts, sums (beams, bins) and floor (beams, bins of floor_bin_m) are added to. What lies above
    the band, or deeper below the floor than an obstacle must stand above it, is counted nowhere.
    """
    beams = counts.shape[0]
    for index in range(points.shape[0]):
        x, y, height = points[index, 0] - place[0], points[index, 1] - place[1], points[index, 2]
        ahead, left = place[2] * x + place[3] * y, place[2] * y - place[3] * x
        if height > band[2] or ahead <= 0.0:
            continue
        beam = math.floor((left / ahead - fan[0]) * fan[1])
        if beam < 0 or beam >= beams:
            continue
        distance = math.sqrt(ahead * ahead + left * left)
        lowest = band[0] + band[1] * distance
        if height > lowest:
            millimetres = int(distance * 1000.0)
            if millimetres < bin_of_mm.shape[0]:
                counts[beam, bin_of_mm[millimetres]] += 1
                sums[beam, bin_of_mm[millimetres]] += distance
        elif height >= -lowest:
            floor_bin = int(distance / floor_bin_m)
            if floor_bin < floor.shape[1]:
                floor[beam, floor_bin] += 1


@njit(cache=True, nogil=True)
def nearest_ranges(counts: Counts, sums: FloatArray, support: int) -> FloatArray:
    """Return the range of the nearest obstacle in each beam (N,), 0 where none: two bins hold `support` points or more.

    From there the peak is sought a few bins on, since the noise of a wall begins before the wall; the range is the mean
    around the peak.
    """
    beams, bins = counts.shape
    ranges = np.zeros(beams)
    for beam in range(beams):
        for first in range(bins - 1):
            if counts[beam, first] + counts[beam, first + 1] < support:
                continue
            peak = first
            for later in range(first + 1, min(first + _CLIMB + 1, bins - 1)):
                if counts[beam, later] + counts[beam, later + 1] > counts[beam, peak] + counts[beam, peak + 1]:
                    peak = later
            low, high = max(peak - 1, 0), min(peak + 3, bins)
            ranges[beam] = sums[beam, low:high].sum() / counts[beam, low:high].sum()
            break
    return ranges


@njit(cache=True, nogil=True)
def floor_ends(floor: Counts, bin_m: float, gap_m: float, gap_per_m2: float) -> FloatArray:
    """Return up to which range the floor was seen in each beam (N,), from the first place to a gap; 0 where nowhere.

    floor (beams, bins of bin_m). At range r a gap may be gap_m + gap_per_m2 r^2 long: the image's rows lie apart there.
    """
    beams, bins = floor.shape
    ends = np.zeros(beams)
    for beam in range(beams):
        for number in range(bins):
            if floor[beam, number] < 2:
                continue
            middle = (number + 0.5) * bin_m
            if ends[beam] > 0.0 and middle - ends[beam] > bin_m + gap_m + gap_per_m2 * middle * middle:
                break
            ends[beam] = middle
    return ends
