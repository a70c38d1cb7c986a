"""Undoing the motion during a turn of the laser: every sample as if taken at one instant.

A turn takes about 100 ms: at 1 rad/s the first and the last ray differ by 5.7 deg. The reference instant is the middle
of the turn, where a wrong twist does the least harm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]


def reference_offset_s(offsets_s: FloatArray) -> float:
    """Return the instant, as an offset in s, to which a turn is brought: the middle between first and last sample."""
    return float(offsets_s[0] + offsets_s[-1]) / 2.0 if len(offsets_s) else 0.0


def deskew(points: FloatArray, offsets_s: FloatArray, reference_s: float, twist: FloatArray) -> FloatArray:
    """Return points (N, 2), each given in the body frame at its own time, in the body frame at reference_s.

    twist (3,) = (vx, vy, wz) of the body in m/s and rad/s, taken as constant over the turn.
    """
    elapsed = (offsets_s - reference_s)[:, np.newaxis]
    return se2.transform_points(se2.exp(twist[np.newaxis, :] * elapsed), points)
