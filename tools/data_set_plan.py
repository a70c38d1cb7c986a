"""What a map data set is to be made of: the options of `data-set`, whatever its kind, and the drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.map_data_set import MapDataSet
from tools.recorded_pairs import Drive


@dataclass(frozen=True, slots=True)
class DataSetPlan:
    """Options of all kinds; None is the kind's own default.

    cells_per_meter: resolutions r. scan_every: rates T, every k-th scan. robots: into how many parts a drive is cut.
    overlap: of two parts' free space, a band of log_windows. seed: of all random choices.
    """

    cells_per_meter: tuple[float, ...] | None = None
    scan_every: tuple[int, ...] | None = None
    robots: int = 6
    overlap: str = "low"
    seed: int = 0


# Writes maps below a new folder and returns the set, whose command and kind the caller fills in.
MakeDataSet = Callable[[Sequence[Drive], DataSetPlan, Path], MapDataSet]


@dataclass(frozen=True, slots=True)
class DataSetKind:
    """A kind of data set: one line on it, how it is made, and how many drives it takes at least and at most."""

    title: str
    make: MakeDataSet
    drives: tuple[int, int | None] = (1, 1)
