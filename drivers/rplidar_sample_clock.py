"""When each sample was taken, from when its packet arrived: a constant-rate clock under one-sided jitter.

The sensor samples at a constant rate and everything on the way (USB latency timer, scheduler, a stalled host) only adds
delay. So arrival - index * period is the clock's offset plus a delay >= 0, and the smallest value seen is the best.
"""

from __future__ import annotations

import math

import numpy as np

from drivers.messages import FloatArray
from drivers.uart import BITS_PER_BYTE

PIPELINE_SAMPLES = 1.5  # age of the last sample when its packet's first bit leaves, in samples [Slamtec SDK]
_LEAK_S_PER_S = 5e-4  # lets the minimum follow a crystal that is slower than nominal
_WINDOW_S = 1.0
_LATE_S = 5e-3  # later than this throughout a window: samples were lost unseen, or the nominal period is wrong


def packet_latency_s(sample_s: float, packet_bytes: int, baud: int) -> float:
    """Age of a packet's last sample when the packet's last bit has arrived over an idle link."""
    return PIPELINE_SAMPLES * sample_s + packet_bytes * BITS_PER_BYTE / baud


class SampleClock:
    """Estimates base, the time of sample 0; times are seconds on the axis of the arrivals that it is fed."""

    def __init__(self, sample_s: float) -> None:
        self.sample_s = sample_s
        self.restart()

    def restart(self) -> None:
        """Forget the offset: an unknown number of samples was lost."""
        self._base_s = math.inf
        self._window_min_s = math.inf
        self._window_start = self._newest = 0

    def observe(self, index: int, not_after_s: float) -> None:
        """Learn that a sample, later than those before, was taken not after not_after_s."""
        if math.isinf(self._base_s):
            self._window_start = self._newest = index
        bound_s = not_after_s - index * self.sample_s
        leaked_s = self._base_s + _LEAK_S_PER_S * (index - self._newest) * self.sample_s
        self._base_s = min(leaked_s, bound_s)
        self._newest = index
        self._window_min_s = min(self._window_min_s, bound_s)
        if (index - self._window_start) * self.sample_s >= _WINDOW_S:
            if self._window_min_s > self._base_s + _LATE_S:
                self._base_s = self._window_min_s
            self._window_start, self._window_min_s = index, math.inf

    def time_s(self, index: int) -> float:
        """Best present estimate of when one sample was taken."""
        return self._base_s + index * self.sample_s

    def times_s(self, first: int, count: int) -> FloatArray:
        """Best present estimate of when count samples were taken, from index first on."""
        return np.asarray(self._base_s + np.arange(first, first + count) * self.sample_s, dtype=np.float64)
