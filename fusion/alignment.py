"""The result of a registration: the relative pose of two maps, how good it is, and the verdict with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """Another pose T_a_b (3,) that the maps leave possible, with its probability."""

    T_a_b: FloatArray
    probability: float

    def inverse(self) -> Alternative:
        """Return the same pose seen from the other map."""
        return replace(self, T_a_b=se2.inverse(self.T_a_b))


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The pose T_a_b (3,) of map b's frame in map a's, how good it is, and the verdict with its reason.

    On refusal it is the best hypothesis, or None. inliers is None where no features were matched; acceptance is omega
    (3.15); overlap, see verification. probability and covariance (3, 3), of x and y in m and yaw in rad as T_a_b has
    them, are None where the method does not tell. scale, only where it was estimated, is how many cells of map a the
    matches say that a cell of map b is. ambiguous: refused because another place fits as well. common_wall_m,
    conflict_m: metres of wall that both maps show in one place, and that stand in the other's free space. slide:
    direction in map a's frame in rad, and metres, in which the pose is loose.
    """

    T_a_b: FloatArray | None
    accepted: bool
    reason: str
    inliers: int | None = None
    acceptance: float = 0.0
    overlap: float = 0.0
    probability: float | None = None
    covariance: FloatArray | None = None
    alternatives: tuple[Alternative, ...] = ()
    scale: float | None = None
    ambiguous: bool = False
    common_wall_m: float | None = None
    conflict_m: float | None = None
    slide: tuple[float, float] | None = None

    def inverse(self) -> Alignment:
        """Return the same verdict for the maps in exchanged order: the pose of map a's frame in map b's."""
        covariance = None
        if self.covariance is not None and self.T_a_b is not None:
            jacobian = inverse_jacobian(self.T_a_b)
            covariance = jacobian @ self.covariance @ jacobian.T
        return replace(
            self,
            T_a_b=None if self.T_a_b is None else se2.inverse(self.T_a_b),
            covariance=covariance,
            alternatives=tuple(each.inverse() for each in self.alternatives),
            scale=None if self.scale is None else 1.0 / self.scale,
            slide=self._slide_in_b(),
        )

    def _slide_in_b(self) -> tuple[float, float] | None:
        if self.slide is None or self.T_a_b is None:
            return None
        return float(self.slide[0] - self.T_a_b[2]), self.slide[1]


def inverse_jacobian(pose: FloatArray) -> FloatArray:
    """Return the derivative (3, 3) of se2.inverse at a pose (3,): by how much x, y, yaw of the inverse change."""
    x, y, yaw = pose.tolist()
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[-cos, -sin, sin * x - cos * y], [sin, -cos, cos * x + sin * y], [0.0, 0.0, -1.0]])
