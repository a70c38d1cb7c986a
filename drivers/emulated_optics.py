"""Optical faults of an emulated lidar: ranges that scatter, samples that measure nothing, rays beside their angle.

What a sample gets depends on the seed and the sample's time alone: however often and in whatever pieces the emulator
asks for the same ray, the answer is the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.emulated_faults import FaultKind, FaultScript
from drivers.messages import FloatArray
from drivers.rplidar_emulated_scan import Ranger

IntArray = NDArray[np.int64]


def faulty_ranger(ranger: Ranger, script: FaultScript) -> Ranger:
    """The ranger with the script's noise, invalid samples and angle jitter, also those that are added later."""

    def measure(times_ns: IntArray, theta_cw_rad: FloatArray) -> FloatArray:
        if not script.of_kind(FaultKind.NOISE, FaultKind.INVALID, FaultKind.JITTER):
            return ranger(times_ns, theta_cw_rad)
        theta = theta_cw_rad + _amounts(script, FaultKind.JITTER, times_ns) * np.radians(normal(times_ns, script.seed))
        ranges = ranger(times_ns, theta)
        spread = _amounts(script, FaultKind.NOISE, times_ns)
        spread += _amounts(script, FaultKind.NOISE, times_ns, place=1) * ranges
        noisy = np.where(ranges > 0.0, np.maximum(ranges + spread * normal(times_ns, script.seed + 1), 0.0), ranges)
        lost = uniform(times_ns, script.seed + 2) < _amounts(script, FaultKind.INVALID, times_ns)
        return np.where(lost, 0.0, noisy)

    return measure


def uniform(times_ns: IntArray, seed: int) -> FloatArray:
    """(N,) in [0, 1), a hash of each time and the seed (SplitMix64: Steele, Lea, Flood, OOPSLA 2014)."""
    with np.errstate(over="ignore"):
        mixed = times_ns.astype(np.uint64) + np.uint64((seed + 1) * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed = mixed ^ (mixed >> np.uint64(31))
    return np.asarray((mixed >> np.uint64(11)).astype(np.float64) * 2.0**-53, dtype=np.float64)


def normal(times_ns: IntArray, seed: int) -> FloatArray:
    """(N,) of a standard normal distribution, likewise (Box and Muller 1958)."""
    radius = np.sqrt(-2.0 * np.log1p(-uniform(times_ns, 2 * seed + 101)))
    return np.asarray(radius * np.cos(2.0 * np.pi * uniform(times_ns, 2 * seed + 102)), dtype=np.float64)


def _amounts(script: FaultScript, kind: FaultKind, times_ns: IntArray, place: int = 0) -> FloatArray:
    """(N,) how strong the fault is at each time."""
    amounts = np.zeros(len(times_ns))
    for fault in script.of_kind(kind):
        start_ns, end_ns = script.span_ns(fault)
        amounts[(times_ns >= start_ns) & (times_ns < end_ns)] = fault.number(place, 0.0)
    return amounts
