"""The inverse sensor model of a depth camera's virtual scan (thesis eq. 2.6): what one beam says about its cells.

Free until the range less two standard deviations, occupied within one to either side, nothing in between and behind.
The evidence of an obstacle is spread over the cells that the noise covers, so that it falls with range; that of a frame
counts once a cell, however many pixels and beams fall into it, since their errors are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.sensor_models import log_odds
from mapping.virtual_scan import VirtualScan

FloatArray = NDArray[np.float64]

_FREE_SIGMAS = 2.0


@dataclass(frozen=True, slots=True)
class DepthModel:
    """Occupancy probabilities that one frame assigns to cells with an obstacle and to free ones, and their reach.

    Obstacles farther than mark_range_m are not drawn, and no beam clears beyond clear_range_m.
    """

    hit_probability: float = 0.65
    miss_probability: float = 0.42
    mark_range_m: float = 3.0
    clear_range_m: float = 4.0

    @property
    def miss_log_odds(self) -> float:
        """The evidence of one traversal: negative."""
        return log_odds(self.miss_probability)

    def free(self, scan: VirtualScan) -> tuple[FloatArray, FloatArray]:
        """Return the ranges in m (N,) from which and up to which each beam clears; 0 and 0 where it clears nothing."""
        end = np.minimum(scan.free_to_m - _FREE_SIGMAS * scan.sigma_m, self.clear_range_m)
        clears = end > scan.free_from_m
        return np.where(clears, scan.free_from_m, 0.0), np.where(clears, end, 0.0)

    def hits(self, scan: VirtualScan, resolution_m: float) -> tuple[FloatArray, FloatArray]:
        """Return points (K, 2) of obstacles in base_link and the log-odds (K,) that each brings to its cell.

        They lie half a cell apart at the most along each beam, from one sigma before its obstacle to one behind it. A
        cell's evidence is the greatest of its points'.
        """
        marked = (scan.ranges_m > 0.0) & (scan.ranges_m <= self.mark_range_m)
        ranges, sigma, angles = scan.ranges_m[marked], scan.sigma_m[marked], scan.angles_rad[marked]
        steps = math.ceil(2.0 * sigma.max(initial=0.0) / resolution_m)
        off = np.arange(-steps, steps + 1) / max(steps, 1)
        along = ranges[:, np.newaxis] + sigma[:, np.newaxis] * off
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = scan.origin + along[..., np.newaxis] * directions[:, np.newaxis, :]
        share = resolution_m / np.maximum(2.0 * sigma, resolution_m)
        evidence = log_odds(self.hit_probability) * share[:, np.newaxis] * np.exp(-0.5 * off**2)
        return points.reshape(-1, 2), evidence.ravel()
