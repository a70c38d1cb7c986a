"""A depth image made ready for mapping: fewer pixels, none out of reach or between two surfaces.

No step invents a depth: what remains was measured. Filters that smooth or fill are left out on purpose: they smear
while the car drives and close doors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.messages import DepthImage, Pinhole

Depth = NDArray[np.uint16]

_NOTHING = np.uint16(65535)  # stands for "no measurement" while depths are ordered: behind everything


@dataclass(frozen=True, slots=True)
class Thinning:
    """What is kept of a depth image.

    decimation: one pixel is made of so many by so many. nearest_m, farthest_m: depths outside are dropped. edge_rad:
    surfaces that a line of sight meets at a flatter angle than this are taken for the ramps that stereo draws between
    an edge and what lies behind it, and dropped.
    """

    decimation: int = 2
    nearest_m: float = 0.3
    farthest_m: float = 4.0
    edge_rad: float = math.radians(6.0)

    def __post_init__(self) -> None:
        if self.decimation < 1:
            raise ValueError(f"decimation {self.decimation} is less than 1")
        if not 0.0 < self.nearest_m < self.farthest_m:
            raise ValueError(f"depth limits {self.nearest_m} m to {self.farthest_m} m are not in order")


def thinned(image: DepthImage, thinning: Thinning) -> DepthImage:
    """Return the smaller image with what can be trusted; its camera sees the same rays."""
    depth = decimated(image.depth, thinning.decimation)
    camera = decimated_camera(image.camera, thinning.decimation)
    nearest, farthest = thinning.nearest_m / image.unit_m, thinning.farthest_m / image.unit_m
    depth[(depth < nearest) | (depth > farthest)] = 0
    depth[hangs_between(depth, 1.0 / (camera.fx * math.tan(thinning.edge_rad)))] = 0
    return DepthImage(image.stamp_ns, depth, image.unit_m, camera, image.frame_id, image.sequence)


def decimated_camera(camera: Pinhole, factor: int) -> Pinhole:
    """Return the camera whose pixels are blocks of factor by factor; incomplete ones at right and below are cut off."""
    middle = 0.5 * (factor - 1)
    return Pinhole(
        camera.width // factor,
        camera.height // factor,
        camera.fx / factor,
        camera.fy / factor,
        (camera.cx - middle) / factor,
        (camera.cy - middle) / factor,
    )


def decimated(depth: Depth, factor: int) -> Depth:
    """Return for each block of factor by factor pixels (rows, cols) the median of what was measured, 0 where nothing.

    Of an even number the nearer of the two in the middle: always a measured depth, never a mean across an edge.
    """
    if factor == 1:
        return np.array(depth)
    rows, cols = depth.shape[0] // factor, depth.shape[1] // factor
    cut = depth[: rows * factor, : cols * factor]
    if factor == 2:
        half = np.empty((rows, cols), np.uint16)
        _halve(cut, half)
        return half
    blocks = cut.reshape(rows, factor, cols, factor).transpose(0, 2, 1, 3).reshape(rows, cols, factor * factor)
    ordered = np.sort(np.where(blocks == 0, _NOTHING, blocks), axis=2)
    measured = np.count_nonzero(blocks, axis=2)
    middle = np.maximum(measured - 1, 0) // 2
    chosen = np.take_along_axis(ordered, middle[..., np.newaxis], axis=2)[..., 0]
    return np.asarray(np.where(measured == 0, 0, chosen), dtype=np.uint16)


def hangs_between(depth: Depth, slope: float) -> NDArray[np.bool_]:
    """Return (rows, cols) True where a measured pixel goes with neither neighbour in its row, but is not the nearest.

    Two pixels go together if their depths differ by at most slope times the depth. Only rows count: a floor seen
    flatly changes as fast along its columns, and what hangs above or below an edge lies behind the edge anyway.
    """
    hanging = np.zeros(depth.shape, np.bool_)
    _find_hanging(depth, np.float32(slope), hanging)
    return hanging


@njit(cache=True, nogil=True)
def _halve(depth: Depth, half: Depth) -> None:
    """Fill half (rows, cols) as `decimated` by 2; four values are ordered by comparisons, without a sort."""
    for row in range(half.shape[0]):
        for col in range(half.shape[1]):
            a, b = depth[2 * row, 2 * col] or _NOTHING, depth[2 * row, 2 * col + 1] or _NOTHING
            c, d = depth[2 * row + 1, 2 * col] or _NOTHING, depth[2 * row + 1, 2 * col + 1] or _NOTHING
            low, high, other_low, other_high = min(a, b), max(a, b), min(c, d), max(c, d)
            inner, other_inner = max(low, other_low), min(high, other_high)
            second, third = min(inner, other_inner), max(inner, other_inner)
            median = min(low, other_low) if third == _NOTHING else second  # of one or two the first, else the second
            half[row, col] = 0 if median == _NOTHING else median


@njit(cache=True, nogil=True)
def _find_hanging(depth: Depth, slope: np.float32, hanging: NDArray[np.bool_]) -> None:
    rows, cols = depth.shape
    for row in range(rows):
        for col in range(cols):
            z = np.int32(depth[row, col])
            if z == 0:
                continue
            left = np.int32(depth[row, col - 1]) if col > 0 else np.int32(0)
            right = np.int32(depth[row, col + 1]) if col + 1 < cols else np.int32(0)
            limit = np.int32(np.float32(z) * slope)
            joined = abs(left - z) <= limit or abs(right - z) <= limit
            nearest = (left == 0 or left > z) and (right == 0 or right > z) and left + right > 0
            hanging[row, col] = not joined and not nearest
