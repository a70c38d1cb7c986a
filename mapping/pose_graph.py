"""The pose graph: keyframe poses that agree best with all measured relative poses, robust against wrong ones.

Sparse Levenberg-Marquardt with analytic Jacobians; Grisetti, Kuemmerle, Stachniss, Burgard, "A tutorial on graph-based
SLAM" (2010). Loop closures have Cauchy's kernel, so that one wrong closure cannot bend the map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from mapping import se2

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_FIRST_DAMPING = 1e-6
_MOST_DAMPING = 1e6
_LEAST_GAIN = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """E measured relative poses: T_first_second[e] (E, 3), with information matrices (E, 3, 3) in second's tangent.

    first, second (E,) number the poses; robust (E,) True where the measurement may be wrong altogether.
    """

    first: IndexArray
    second: IndexArray
    T_first_second: FloatArray
    information: FloatArray
    robust: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.first)

    def joined(self, other: Constraints) -> Constraints:
        """Return these and other's."""
        return Constraints(
            np.concatenate([self.first, other.first]),
            np.concatenate([self.second, other.second]),
            np.concatenate([self.T_first_second, other.T_first_second]),
            np.concatenate([self.information, other.information]),
            np.concatenate([self.robust, other.robust]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class GraphSolution:
    """Optimised poses (K, 3), squared normalised error (E,) of each constraint there, their robust sum, iterations."""

    poses: FloatArray
    chi2: FloatArray
    cost: float
    iterations: int


def residuals(poses: FloatArray, constraints: Constraints) -> FloatArray:
    """Return the differences (E, 3) between the poses' relative poses and the measured ones, x, y, yaw in m and rad."""
    return se2.between(constraints.T_first_second, se2.between(poses[constraints.first], poses[constraints.second]))


def chi_squared(poses: FloatArray, constraints: Constraints) -> FloatArray:
    """Return the squared normalised error (E,) of each constraint; 3 degrees of freedom."""
    error = residuals(poses, constraints)
    return np.asarray(np.einsum("ea,eab,eb->e", error, constraints.information, error))


def shortest_ways(count: int, first: IndexArray, second: IndexArray, lengths: FloatArray, source: int) -> FloatArray:
    """Return how far (count,) it is from pose `source` to each along pairs (E,), (E,) of given lengths; inf: no way."""
    pairs = sp.coo_matrix((np.maximum(lengths, 1e-9), (first, second)), shape=(count, count))
    return np.asarray(dijkstra(pairs.tocsr(), directed=False, indices=source))


class NormalEquations:
    """Sparse Gauss-Newton equations over x, y, yaw of `count` poses, of which one is held.

    Sum up with `add` what pairs of poses say, then `solve`.
    """

    def __init__(self, count: int, fixed: int) -> None:
        self._count = count
        self._fixed = fixed
        self._rows: list[IndexArray] = []
        self._cols: list[IndexArray] = []
        self._blocks: list[FloatArray] = []
        self._gradient = np.zeros((count, 3))

    def add(self, first: IndexArray, second: IndexArray, hessians: FloatArray, gradients: FloatArray) -> None:
        """Add hessians (E, 6, 6) and gradients (E, 6) over the poses first (E,), then second (E,)."""
        for a, row in ((0, first), (3, second)):
            np.add.at(self._gradient, row, gradients[:, a : a + 3])
            for b, col in ((0, first), (3, second)):
                self._rows.append(row)
                self._cols.append(col)
                self._blocks.append(hessians[:, a : a + 3, b : b + 3])

    def solve(self, damping: float) -> FloatArray:
        """Return the step (K, 3) that Levenberg's damping, a share of the diagonal, allows."""
        rows, cols, blocks = np.concatenate(self._rows), np.concatenate(self._cols), np.concatenate(self._blocks)
        inner = np.arange(3)
        all_rows = np.broadcast_to(3 * rows[:, None, None] + inner[:, None], blocks.shape).ravel()
        all_cols = np.broadcast_to(3 * cols[:, None, None] + inner[None, :], blocks.shape).ravel()
        size = 3 * self._count
        hessian = sp.coo_matrix((blocks.ravel(), (all_rows, all_cols)), shape=(size, size)).tocsc()
        kept = np.delete(np.arange(size), [3 * self._fixed, 3 * self._fixed + 1, 3 * self._fixed + 2])
        hessian = hessian[kept][:, kept]
        damped = hessian + sp.diags(damping * hessian.diagonal() + 1e-12, format="csc")
        factor = splu(
            damped.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        step = np.zeros(size)
        step[kept] = factor.solve(-self._gradient.ravel()[kept])
        return step.reshape(-1, 3)


def optimise(
    poses: FloatArray, constraints: Constraints, *, kernel: float = 1.0, iterations: int = 20, fixed: int = 0
) -> GraphSolution:
    """Return the poses (K, 3) with the least cost; pose `fixed` stays, and every pose must hang on it by constraints.

    kernel: Cauchy's scale, in standard deviations, for the constraints marked robust.
    """
    current = np.array(poses, dtype=np.float64)
    cost, done, damping = _cost(current, constraints, kernel), 0, _FIRST_DAMPING
    while done < iterations and damping < _MOST_DAMPING:
        done += 1
        equations = NormalEquations(len(current), fixed)
        weights = robust_weights(current, constraints, kernel)
        equations.add(constraints.first, constraints.second, *linearise(current, constraints, weights))
        trial = current + equations.solve(damping)
        trial[:, 2] = se2.wrap_angle(trial[:, 2])
        trial_cost = _cost(trial, constraints, kernel)
        if not trial_cost < cost:
            damping *= 100.0
            continue
        gain = (cost - trial_cost) / max(cost, 1e-12)
        current, cost, damping = trial, trial_cost, max(damping / 10.0, 1e-9)
        if gain < _LEAST_GAIN:
            break
    return GraphSolution(current, chi_squared(current, constraints), cost, done)


def linearise(poses: FloatArray, constraints: Constraints, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return hessians (E, 6, 6) and gradients (E, 6) of weighted constraints over their first and second poses."""
    jacobians = _jacobians(poses, constraints)
    left = np.einsum("eba,ebc->eac", jacobians, constraints.information * weights[:, None, None])
    return left @ jacobians, np.einsum("eab,eb->ea", left, residuals(poses, constraints))


def _jacobians(poses: FloatArray, constraints: Constraints) -> FloatArray:
    """Return the derivatives (E, 3, 6) of the residuals by the first and the second pose."""
    first, second, measured = poses[constraints.first], poses[constraints.second], constraints.T_first_second
    angle = first[:, 2] + measured[:, 2]
    cos, sin = np.cos(angle), np.sin(angle)
    apart = second[:, :2] - first[:, :2]
    jacobians = np.zeros((len(constraints), 3, 6))
    jacobians[:, 0, 3], jacobians[:, 0, 4] = cos, sin
    jacobians[:, 1, 3], jacobians[:, 1, 4] = -sin, cos
    jacobians[:, 2, 5] = 1.0
    jacobians[:, :, :3] = -jacobians[:, :, 3:]
    jacobians[:, 0, 2] = -sin * apart[:, 0] + cos * apart[:, 1]
    jacobians[:, 1, 2] = -cos * apart[:, 0] - sin * apart[:, 1]
    return jacobians


def robust_weights(poses: FloatArray, constraints: Constraints, kernel: float) -> FloatArray:
    """Return Cauchy's weights (E,): 1 where a constraint is not marked robust."""
    return np.where(constraints.robust, 1.0 / (1.0 + chi_squared(poses, constraints) / kernel**2), 1.0)


def _cost(poses: FloatArray, constraints: Constraints, kernel: float) -> float:
    chi2 = chi_squared(poses, constraints)
    return float(np.where(constraints.robust, kernel**2 * np.log1p(chi2 / kernel**2), chi2).sum())
