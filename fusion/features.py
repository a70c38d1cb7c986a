"""Stage 2 of Algorithm 3: KAZE keypoints (thesis section 3.2) with SIFT descriptors (section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.free_space import Layer

FloatArray = NDArray[np.float64]
_THRESHOLD, _OCTAVES, _SUBLEVELS = 1e-4, 3, 4  # MATLAB's defaults, which the thesis used
_STRONGEST = 5000  # matching costs the product of both maps' numbers
_MARGIN = 16  # keypoints need surroundings: free space that touches the image's edge would have none


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """points (N, 2) as x, y in cells of the layer, (0.5, 0.5) the centre of the first; descriptors (N, 128)."""

    points: FloatArray
    descriptors: NDArray[np.float32]


def detect_features(layer: Layer) -> Features:
    """Find keypoints as extrema of the determinant of the Hessian (3.10) in KAZE's scale space (3.3-3.9).

    The keypoints must come from `detectAndCompute`: `detect` alone leaves every orientation at 0, and then descriptors
    of a turned map match nothing. KAZE's own descriptors are dropped for SIFT's.
    """
    nothing = Features(np.empty((0, 2)), np.empty((0, 128), np.float32))
    if not layer.any():
        return nothing
    image = cv2.copyMakeBorder(layer, *(4 * (_MARGIN,)), cv2.BORDER_CONSTANT, value=0)
    kaze = cv2.KAZE.create(False, False, _THRESHOLD, _OCTAVES, _SUBLEVELS)
    keypoints, _ = kaze.detectAndCompute(image, None)
    strongest = sorted(keypoints, key=lambda keypoint: -keypoint.response)[:_STRONGEST]
    if not strongest:
        return nothing
    described, descriptors = cv2.SIFT.create().compute(image, strongest)
    points = np.array([keypoint.pt for keypoint in described], dtype=np.float64).reshape(-1, 2)
    # OpenCV counts from the centre of the first pixel.
    return Features(points + 0.5 - _MARGIN, np.asarray(descriptors, dtype=np.float32).reshape(-1, 128))
