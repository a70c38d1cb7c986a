"""The ways to merge two maps that chapter 5's experiments set beside each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

from fusion.algorithm3 import THESIS
from tools.pair_registration import Registration


@dataclass(frozen=True, slots=True)
class MergingMethod:
    """A registration, what it is called, and how many of so many runs that differ in their seed are worth it."""

    title: str
    registration: Registration
    most_runs: int


# Section 5.3 has the moving map brought to the cell of the fixed one, which is the finer: common_cell "fine".
_AS_WRITTEN = replace(THESIS, common_cell="fine")
_REAL_MAPS = replace(THESIS, alpha=0.5, max_ratio=0.8, tolerance_px=3.0, trials=5000)

METHODS: MappingProxyType[str, MergingMethod] = MappingProxyType(
    {
        "thesis": MergingMethod("Algorithm 3, the thesis's numbers", Registration("thesis", _AS_WRITTEN, 0), 100_000),
        "real": MergingMethod(
            "Algorithm 3, alpha 0.5, ratio 0.8, 3 px, 5000 trials", Registration("thesis", _REAL_MAPS, 0), 100_000
        ),
        "default": MergingMethod("the default method", Registration("default", THESIS, 0), 10),
    }
)
