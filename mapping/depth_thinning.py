"""A depth image made ready for mapping: fewer pixels, none out of reach or between two surfaces.

No step invents a depth: what remains was measured. Filters that smooth or fill are left out on purpose: they smear
while the car drives and close doors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
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
        return _median_of_four(cut[::2, ::2], cut[::2, 1::2], cut[1::2, ::2], cut[1::2, 1::2])
    blocks = cut.reshape(rows, factor, cols, factor).transpose(0, 2, 1, 3).reshape(rows, cols, factor * factor)
    ordered = np.sort(np.where(blocks == 0, _NOTHING, blocks), axis=2)
    measured = np.count_nonzero(blocks, axis=2)
    middle = np.maximum(measured - 1, 0) // 2
    chosen = np.take_along_axis(ordered, middle[..., np.newaxis], axis=2)[..., 0]
    return np.asarray(np.where(measured == 0, 0, chosen), dtype=np.uint16)


def _median_of_four(a: Depth, b: Depth, c: Depth, d: Depth) -> Depth:
    """As `decimated` for blocks of four, by comparing whole images: sorting each block takes twenty times as long."""
    a, b, c, d = (np.where(part == 0, _NOTHING, part) for part in (a, b, c, d))
    low, high = np.minimum(a, b), np.maximum(a, b)
    other_low, other_high = np.minimum(c, d), np.maximum(c, d)
    first = np.minimum(low, other_low)
    inner, other_inner = np.maximum(low, other_low), np.minimum(high, other_high)
    second, third = np.minimum(inner, other_inner), np.maximum(inner, other_inner)
    median = np.where(third == _NOTHING, first, second)  # of one or two the first, of three or four the second
    median[median == _NOTHING] = 0
    return median


def hangs_between(depth: Depth, slope: float) -> NDArray[np.bool_]:
    """Return (rows, cols) True where a measured pixel goes with neither neighbour in its row, but is not the nearest.

    Two pixels go together if their depths differ by at most slope times the depth. Only rows count: a floor seen
    flatly changes as fast along its columns, and what hangs above or below an edge lies behind the edge anyway.
    """
    z = depth.astype(np.int32)
    limit = (depth * np.float32(slope)).astype(np.int32)
    padded = np.pad(z, ((0, 0), (1, 1)))
    left, right = padded[:, :-2], padded[:, 2:]
    joined = (np.abs(left - z) <= limit) | (np.abs(right - z) <= limit)
    nearest = (np.where(left == 0, z + 1, left) > z) & (np.where(right == 0, z + 1, right) > z) & (left + right > 0)
    hanging: NDArray[np.bool_] = (z > 0) & ~joined & ~nearest
    return hanging
