"""Peers of the registration, written anew from how they are described: other ways to the pose of one grid in another.

m-explore: the ROS package's map merging (Hörner, "Map-merging for multi-robot system", 2016) on OpenCV's stitching
parts. Fourier-Mellin: Reddy and Chatterji, "An FFT-based technique for translation, rotation, and scale-invariant
image registration" (1996). Both know the resolutions, so neither has to find a scale. See also fusion_bench.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.free_space import rescale
from fusion.resampling import cut_to_known
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.metrics import align_points

FloatArray = NDArray[np.float64]
Image = NDArray[np.float32]
_UNKNOWN = 255  # -1 of a ROS grid, read as a byte
_MARGIN = 40  # unknown cells around a grid, as a mapper publishes it: ORB finds nothing within 31 px of the edge
_MATCH_CONFIDENCE = 0.3  # OpenCV's: the best match is kept below 0.7 of the second best's distance
_MERGE_ABOVE = 1.0  # m-explore's estimation_confidence
_EXTENT_PX = 512  # the larger map's diagonal in the spectrum's picture, which is twice as wide
_ANGLES = 1440  # over 360 deg


@dataclass(frozen=True, slots=True, eq=False)
class PeerPose:
    """T_a_b (3,), None where nothing was found; whether the method would merge the maps and why, None: no verdict."""

    T_a_b: FloatArray | None
    merges: bool | None = None
    confidence: float | None = None


def register_as_m_explore(a: OccupancyGrid, b: OccupancyGrid, detector: Literal["orb", "akaze"], seed: int) -> PeerPose:
    """Match binary features of two grids read as pictures, and fit a similarity to them by RANSAC.

    Its scale is forced to 1, the turn being about the inliers' centre; m-explore itself keeps it. Grids of two
    resolutions, which m-explore does not take, are brought to the coarser one. seed: of the approximate matching.
    """
    cell_m = max(a.resolution_m, b.resolution_m)
    grids = cut_to_known(a), cut_to_known(b)
    finder = cv2.ORB.create() if detector == "orb" else cv2.AKAZE.create()
    found = [cv2.detail.computeImageFeatures2(finder, _ros_picture(grid, cell_m)) for grid in grids]
    keypoints = [features.getKeypoints() for features in found]
    if min(len(points) for points in keypoints) < 2:
        return PeerPose(None, False, 0.0)
    cv2.setRNGSeed(seed)  # OpenCV has no other way to seed its hash tables
    matcher = cv2.detail.AffineBestOf2NearestMatcher(False, False, _MATCH_CONFIDENCE)
    info = matcher.apply(found[0], found[1])
    inliers = np.asarray(info.getInliers(), dtype=np.bool_).ravel()
    if np.count_nonzero(inliers) < 2:
        return PeerPose(None, False, info.confidence)
    matches = [match for match, is_inlier in zip(info.getMatches(), inliers, strict=True) if is_inlier]
    points_a = np.array([keypoints[0][match.queryIdx].pt for match in matches], dtype=np.float64)
    points_b = np.array([keypoints[1][match.trainIdx].pt for match in matches], dtype=np.float64)
    in_maps = [
        se2.transform_points(grid.origin, (points + 0.5 - _MARGIN) * cell_m)  # OpenCV counts from a pixel's centre
        for grid, points in zip(grids, (points_a, points_b), strict=True)
    ]
    return PeerPose(align_points(in_maps[0], in_maps[1]), info.confidence > _MERGE_ABOVE, info.confidence)


def _ros_picture(grid: OccupancyGrid, cell_m: float) -> NDArray[np.uint8]:
    """Return the grid as nav_msgs/OccupancyGrid has it, 0 to 100 and -1 for unknown, each cell read as a byte."""
    cells = np.where(grid.known, np.rint(100.0 * grid.probability), _UNKNOWN).astype(np.uint8)
    picture = rescale(cells, grid.resolution_m, cell_m)
    return np.asarray(cv2.copyMakeBorder(picture, *(4 * (_MARGIN,)), cv2.BORDER_CONSTANT, value=_UNKNOWN), np.uint8)


def register_by_spectra(a: OccupancyGrid, b: OccupancyGrid) -> PeerPose:
    """Find the turn from the magnitudes of both free spaces' spectra, then the shift of both half turns by phase.

    No scale is looked for. The half turn whose shift has the sharper peak wins; there is no verdict.
    """
    grids = cut_to_known(a), cut_to_known(b)
    diagonal_m = max(math.hypot(*grid.log_odds.shape) * grid.resolution_m for grid in grids)
    cell_m = max(a.resolution_m, b.resolution_m, diagonal_m / _EXTENT_PX)
    (fixed, T_a_picture), (moving, T_b_picture) = (_centred_free_space(grid, cell_m) for grid in grids)
    if not (fixed.any() and moving.any()):
        return PeerPose(None)
    half_turn = _half_turn(_polar_spectrum(fixed), _polar_spectrum(moving))
    found = [_shifted(fixed, moving, turn, cell_m) for turn in (half_turn, half_turn + math.pi)]
    _, T_pictures = max(found, key=lambda each: each[0])
    return PeerPose(se2.compose(se2.compose(T_a_picture, T_pictures), se2.inverse(T_b_picture)))


def _centred_free_space(grid: OccupancyGrid, cell_m: float) -> tuple[Image, FloatArray]:
    """Return p(free) above one half in the middle of a square picture, and the pose (3,) of its first corner."""
    free = np.where(grid.known, np.maximum(1.0 - 2.0 * grid.probability, 0.0), 0.0).astype(np.float32)
    scale = grid.resolution_m / cell_m
    padded = np.pad(free, (0, math.ceil(1.0 / scale)))  # at least a cell is left
    pooled = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else padded
    rows, cols = pooled.shape
    picture = np.zeros((2 * _EXTENT_PX, 2 * _EXTENT_PX), np.float32)
    row, col = _EXTENT_PX - rows // 2, _EXTENT_PX - cols // 2
    picture[row : row + rows, col : col + cols] = pooled
    return picture, se2.compose(grid.origin, np.array([-col * cell_m, -row * cell_m, 0.0]))


def _polar_spectrum(picture: Image) -> Image:
    """Return the magnitude of the spectrum over half a turn (angles) and the logarithm of the frequency.

    Its low frequencies are weakened by the high-pass of Reddy and Chatterji (1 - X)(2 - X), X = cos(pi u) cos(pi v).
    """
    size = len(picture)
    spectrum = cv2.dft(picture, flags=cv2.DFT_COMPLEX_OUTPUT)
    magnitude = np.fft.fftshift(cv2.magnitude(spectrum[..., 0], spectrum[..., 1]))
    cosine = np.cos(np.pi * (np.arange(size) / size - 0.5)).astype(np.float32)
    product = np.outer(cosine, cosine)
    high = magnitude * (1.0 - product) * (2.0 - product)
    flags = cv2.INTER_LINEAR | cv2.WARP_POLAR_LOG
    polar = cv2.warpPolar(high, (_EXTENT_PX, _ANGLES), (size / 2, size / 2), size / 2, flags)
    return np.asarray(polar[: _ANGLES // 2], np.float32)


def _half_turn(fixed: Image, moving: Image) -> float:
    """Return the angle in [0, pi) by which moving must turn: phase correlation of polar spectra along the angle."""
    product = (np.fft.fft(fixed, axis=0) * np.conj(np.fft.fft(moving, axis=0))).sum(axis=1)
    correlation = np.fft.ifft(product / (np.abs(product) + 1e-9)).real
    return float(np.argmax(correlation)) * 2.0 * math.pi / _ANGLES


def _shifted(fixed: Image, moving: Image, turn: float, cell_m: float) -> tuple[float, FloatArray]:
    """Return the peak's height and the pose (3,) of the moving picture in the fixed one, given its turn."""
    size = len(fixed)
    middle = (size - 1) / 2
    turned = cv2.warpAffine(
        moving, cv2.getRotationMatrix2D((middle, middle), -math.degrees(turn), 1.0), (size, size)
    )  # OpenCV's y points down
    (x, y), response = cv2.phaseCorrelate(turned, fixed)
    center = np.full(2, size / 2) * cell_m
    about_center = np.array([*(center + np.array([x, y]) * cell_m), turn])
    return response, se2.compose(about_center, np.array([*-center, 0.0]))
