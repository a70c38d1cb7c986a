"""Where the laser sits on the body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Where the laser sits on the body: a pose (x, y, yaw) in base_link; inverted for one that hangs upside down."""

    pose: FloatArray = field(default_factory=lambda: np.zeros(3))
    inverted: bool = False

    def to_body(self, angles_rad: FloatArray, ranges_m: FloatArray) -> FloatArray:
        """Return samples (N,) given in the laser frame as points (N, 2) in base_link."""
        side = -1.0 if self.inverted else 1.0
        local = np.column_stack([ranges_m * np.cos(angles_rad), side * ranges_m * np.sin(angles_rad)])
        return se2.transform_points(self.pose, local)
