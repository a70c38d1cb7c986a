"""What a D435 makes of true depth: made in disparity, as stereo matching does, not by the formula that mapping assumes.

A disparity is wrong by a smooth field over the image, which is larger where the scene has little texture, and by a
little of each pixel's own; it comes in steps of 1/32 px. Edges are smeared over the matching window, what only one of
the two imagers sees is missing, as are the left margin and random patches.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_STEPS_PER_PX = 32.0
_MAX_DISPARITY_PX = 126.0
_EDGE_PX = 1.0  # neighbours whose disparities differ by more are two surfaces


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """How bad the camera is.

    disparity_px: typical error of a disparity; patch_px: how far over the image errors are alike. own_px: the part that
    each pixel has for itself. hole_share: share of the image lost in patches. window_px: matching window, over which
    edges are smeared. range_bias: depths are too large by this share.
    """

    disparity_px: float = 0.08
    patch_px: float = 7.0
    own_px: float = 0.02
    hole_share: float = 0.05
    window_px: int = 7
    baseline_m: float = 0.05
    range_bias: float = 0.0


NO_NOISE = DepthNoise(disparity_px=0.0, own_px=0.0, hole_share=0.0, window_px=1)


def noisy_depth(
    true_m: Image, focal_px: float, noise: DepthNoise, random: np.random.Generator, unit_m: float
) -> NDArray[np.uint16]:
    """Return the measured depth (rows, cols) in units of unit_m, 0 where there is none, of true depth (rows, cols)."""
    base = focal_px * noise.baseline_m
    seen = true_m > 0.0
    exact = np.where(seen, base / np.where(seen, true_m, 1.0), 0.0).astype(np.float32)
    disparity, is_edge = _smeared(exact, noise.window_px)
    lost = ~seen | _hidden(exact) | (exact > _MAX_DISPARITY_PX)
    if noise.disparity_px > 0.0:
        little_texture = np.float32(0.6) + np.float32(0.8) * np.abs(
            _field(true_m.shape, 60.0, random)
        )  # 0.6 to about 2.5
        alike = np.float32(noise.disparity_px) * _field(true_m.shape, noise.patch_px, random)
        disparity = disparity + little_texture * alike
    if noise.own_px > 0.0:
        disparity = disparity + np.float32(noise.own_px) * random.standard_normal(true_m.shape, dtype=np.float32)
    if noise.hole_share > 0.0:
        patches = _field(true_m.shape, 12.0, random)
        lost |= patches < np.quantile(patches[::4, ::4], noise.hole_share)
        lost |= is_edge & (_field(true_m.shape, 3.0, random) < -0.4)  # matching gives up at a third of the edges
    stepped = np.rint(disparity * _STEPS_PER_PX) / _STEPS_PER_PX
    usable = ~lost & (stepped > 0.0)
    depth_m = (1.0 + noise.range_bias) * base / np.where(usable, stepped, 1.0)
    units = np.rint(depth_m / unit_m)
    return np.where(usable & (units < 65536.0), units, 0.0).astype(np.uint16)


def _field(shape: tuple[int, ...], patch_px: float, random: np.random.Generator) -> Image:
    """Return a smooth field (rows, cols) of standard deviation 1 and mean 0 whose values are alike over patch_px."""
    rows, cols = shape
    coarse = random.standard_normal((round(rows / patch_px) + 2, round(cols / patch_px) + 2), dtype=np.float32)
    smooth = np.asarray(cv2.resize(coarse, (cols, rows), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    return np.asarray(smooth * np.float32(1.5), dtype=np.float32)  # linear interpolation halves the variance (4/9)


def _smeared(disparity: Image, window_px: int) -> tuple[Image, NDArray[np.bool_]]:
    """Return the disparity with ramps of a window's width at edges, and (rows, cols) True where these are."""
    if window_px <= 1:
        return disparity, np.zeros(disparity.shape, np.bool_)
    window = np.ones((window_px, window_px), np.uint8)
    is_edge = cv2.dilate(disparity, window) - cv2.erode(disparity, window) > _EDGE_PX
    jump = cv2.dilate(disparity, np.ones((3, 3), np.uint8)) - cv2.erode(disparity, np.ones((3, 3), np.uint8)) > _EDGE_PX
    near_jump = cv2.dilate(jump.astype(np.uint8), window) > 0
    ramps = np.asarray(cv2.blur(disparity, (window_px, window_px)), dtype=np.float32)
    smeared = is_edge & near_jump
    return np.where(smeared, ramps, disparity), smeared


def _hidden(disparity: Image) -> NDArray[np.bool_]:
    """Return (rows, cols) True where the right imager sees nothing of a pixel of the left one.

    A pixel at column u lies at u - disparity in the right image: outside for the left margin, and behind whatever of
    the same row lands there or farther left while it stands farther right.
    """
    landing = np.arange(disparity.shape[1], dtype=np.float32) - disparity
    leftmost = np.minimum.accumulate(landing[:, ::-1], axis=1)[:, ::-1]
    covered = np.zeros(disparity.shape, np.bool_)
    covered[:, :-1] = landing[:, :-1] > leftmost[:, 1:]
    return covered | (landing < 0.0)
