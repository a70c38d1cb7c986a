"""Rotations as the messages hold them: unit quaternions x, y, z, w."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def quaternion(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix that may be a little off.

    It is the eigenvector of the largest eigenvalue of a 4x4 matrix (Bar-Itzhack 2000), which leaves no special case.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    symmetric = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    _, vectors = np.linalg.eigh(symmetric)
    best = vectors[:, -1]
    return np.asarray(best if best[3] >= 0 else -best, dtype=np.float64)
