"""Stage 3 of Algorithm 3: putative matches by the ratio test (thesis section 3.4)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Descriptors = NDArray[np.float32] | NDArray[np.uint8]


def match_descriptors(a: Descriptors, b: Descriptors, max_ratio: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices (M,) in a and (M,) in b of descriptors (N, K) that match.

    A match is b's nearest neighbour in a by the sum of squared differences (3.11), if that is less than max_ratio times
    the second nearest's. The ratio is one of SSDs, as in MATLAB: 0.6 is 0.775 of distances. Descriptors of bits (uint8)
    differ by their Hamming distance, which is the SSD of the bits, so that one ratio serves both. No descriptor of a is
    used twice: the nearest one keeps it, so that a count of matches counts places.
    """
    nothing = np.empty(0, np.intp), np.empty(0, np.intp)
    if len(a) < 2 or len(b) < 1:
        return nothing
    norm = cv2.NORM_HAMMING if a.dtype == np.uint8 else cv2.NORM_L2SQR
    pairs = cv2.BFMatcher(norm).knnMatch(b, a, k=2)
    kept = [first for first, second in pairs if first.distance < max_ratio * second.distance]
    kept.sort(key=lambda match: match.distance)
    in_a = np.array([match.trainIdx for match in kept], dtype=np.intp)
    in_b = np.array([match.queryIdx for match in kept], dtype=np.intp)
    _, once = np.unique(in_a, return_index=True)
    return in_a[once], in_b[once]
