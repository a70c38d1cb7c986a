"""Inverse sensor models: how much one measurement says about the cells it touches (thesis eq. 2.6).

The model of a lidar here is the usual hit/miss one of Thrun, Burgard, Fox, "Probabilistic Robotics" (2005), table 9.2,
with the evidence of a hit spread over as many cells as the range noise covers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def log_odds(probability: float) -> float:
    """Return log(p / (1 - p)) (thesis eq. 2.7); raise ValueError outside (0, 1)."""
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability {probability} is not inside (0, 1)")
    return math.log(probability / (1.0 - probability))


@dataclass(frozen=True, slots=True)
class LidarModel:
    """Occupancy probabilities that one scan assigns to hit and to traversed cells, and the reach of the model.

    Rays longer than max_range_m clear cells up to there and mark none. noise_fraction: standard deviation of a range as
    a share of the range (RPLIDAR-A2 datasheet: 1 %).
    """

    hit_probability: float = 0.7
    miss_probability: float = 0.4
    max_range_m: float = 12.0
    noise_fraction: float = 0.01

    def hit_log_odds(self, ranges_m: FloatArray, resolution_m: float) -> FloatArray:
        """Return the evidence (N,) of hits at ranges_m (N,): full while the noise fits a cell, then in proportion."""
        spread_m = 2.0 * self.noise_fraction * ranges_m
        share: FloatArray = resolution_m / np.maximum(spread_m, resolution_m)
        return log_odds(self.hit_probability) * share

    @property
    def miss_log_odds(self) -> float:
        """The evidence of one traversal: negative."""
        return log_odds(self.miss_probability)
