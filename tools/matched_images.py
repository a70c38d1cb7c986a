"""One matching of two map images by features, timed: detection, description, matching, MSAC (thesis eq. 4.1 to 4.4).

Times are of the CPU, which other work on the computer changes less than the clock on the wall; OpenCV has one thread.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.algorithm3 import THESIS
from fusion.consensus import find_consensus
from fusion.features import Descriptors, FeatureMethod, Features, detect_features
from fusion.free_space import Layer, free_layer
from fusion.matching import match_descriptors
from fusion.occupancy_image import free_image, occupancy_image
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
METHODS = (FeatureMethod("kaze", "kaze"), FeatureMethod("orb"), FeatureMethod("sift"))  # table 4.2, each by itself
_MATLAB_SHARE_OF_BITS, _MATLAB_SSD = 0.10, 0.04  # of matchFeatures: 10 % of the bits; 1 % of 4, for unit vectors


@dataclass(frozen=True, slots=True, eq=False)
class TimedFeatures:
    """All features of an image, and the CPU seconds of detection and description."""

    features: Features
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Putative:
    """Matched points (M, 2) in cells of each image, and the CPU seconds of matching.

    near (M,): those that MATLAB's matchFeatures, which has a limit of distance by default, would keep.
    """

    fixed: FloatArray
    moving: FloatArray
    near: NDArray[np.bool_]
    seconds: float


@dataclass(frozen=True, slots=True)
class Match:
    """Putative matches, those that MSAC keeps, and the motion they agree on; None where there is none.

    turn_rad and scale: of the moving image's points onto the fixed one's. seconds: CPU time of matching and MSAC.
    """

    matches: int
    inliers: int
    turn_rad: float | None
    scale: float | None
    seconds: float

    @property
    def precision(self) -> float | None:
        """Inliers a match (4.1); None without matches."""
        return self.inliers / self.matches if self.matches else None


def image_of(grid: OccupancyGrid, alpha: float | None) -> Layer:
    """Return O^free of a map at alpha, for None O (section 4.1.3), and for 0 the probabilities that both come from."""
    if alpha is None:
        return occupancy_image(grid)
    return free_layer(grid, 0.0) if alpha == 0.0 else free_image(grid, alpha)


def image_name(alpha: float | None) -> str:
    """Return how an image is called in tables."""
    return {None: "O", 0.0: "O as probabilities"}.get(alpha, f"O^free, alpha {alpha}")


def timed_features(image: Layer, method: FeatureMethod) -> TimedFeatures:
    """Detect and describe all keypoints of an image: the thesis names no limit."""
    started = time.process_time()
    features = detect_features(image, method, strongest=None)
    return TimedFeatures(features, time.process_time() - started)


def putative_matches(fixed: Features, moving: Features) -> Putative:
    """Match features by the ratio test with the thesis's ratio."""
    started = time.process_time()
    in_fixed, in_moving = match_descriptors(fixed.descriptors, moving.descriptors, THESIS.max_ratio)
    seconds = time.process_time() - started
    near = _within_matlabs_limit(fixed.descriptors[in_fixed], moving.descriptors[in_moving])
    return Putative(fixed.points[in_fixed], moving.points[in_moving], near, seconds)


def agreement(putative: Putative, seed: int, *, similarity: bool, only_near: bool = False) -> Match:
    """Find the rigid motion, or similarity, that most matches agree on, by MSAC with the thesis's numbers."""
    kept = putative.near if only_near else np.ones(len(putative.near), np.bool_)
    started = time.process_time()
    consensus = find_consensus(
        putative.fixed[kept],
        putative.moving[kept],
        THESIS.tolerance_px,
        trials=THESIS.trials,
        confidence=THESIS.confidence,
        seed=seed,
        free_scale=similarity,
    )
    seconds = putative.seconds + time.process_time() - started
    matches = int(np.count_nonzero(kept))
    if consensus is None:
        return Match(matches, 0, None, None, seconds)
    inliers = int(np.count_nonzero(consensus.inliers))
    return Match(matches, inliers, float(consensus.T_a_b[2]), consensus.scale, seconds)


def _within_matlabs_limit(a: Descriptors, b: Descriptors) -> NDArray[np.bool_]:
    """Return which of the matches (M,) MATLAB's matchFeatures would keep with its default MatchThreshold."""
    if a.dtype == np.uint8 and b.dtype == np.uint8:
        bits = np.unpackbits(np.bitwise_xor(a.astype(np.uint8), b.astype(np.uint8)), axis=1)
        return np.asarray(bits.sum(axis=1) <= _MATLAB_SHARE_OF_BITS * bits.shape[1])
    unit_a, unit_b = (each / np.maximum(np.linalg.norm(each, axis=1, keepdims=True), 1e-9) for each in (a, b))
    return np.asarray(((unit_a - unit_b) ** 2).sum(axis=1) <= _MATLAB_SSD)
