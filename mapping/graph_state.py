"""Everything that a pose graph holds, as named arrays: what a file keeps and another drive goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from mapping.keyframes import Clouds

_STATE = (
    "starts", "poses", "travelled", "segments", "link_poses", "link_information", "link_connected", "link_doubtful",
    "sensor", "closure_pairs", "closure_poses", "closure_information", "closure_evidence",
)  # fmt: skip
CLOUDS = ("points", "angles", "ranges", "normals", "levels", "reaches")
SCANS = ("stamps_ns", "keyframes", "relative", "counts", "points", "matched", "known", "is_keyframe")


@dataclass(frozen=True, slots=True, eq=False)
class GraphState:
    """Everything that a graph holds, as named arrays; raises ValueError where some are missing or do not fit."""

    arrays: Mapping[str, NDArray[Any]]

    def __post_init__(self) -> None:
        names = [*_STATE, *(f"cloud_{name}" for name in CLOUDS), *(f"scan_{name}" for name in SCANS)]
        missing = [name for name in names if name not in self.arrays]
        if missing:
            raise ValueError(f"no {', '.join(missing)} in it")
        count = len(self.arrays["poses"])
        if count == 0 or len(self.arrays["starts"]) != count + 1:
            raise ValueError(f"{count} poses for {len(self.arrays['starts']) - 1} keyframes")

    @property
    def end_ns(self) -> int:
        """The stamp of the last scan."""
        return int(self.arrays["scan_stamps_ns"][-1])

    @property
    def clouds(self) -> Clouds:
        """The keyframes' surfaces."""
        columns = {name: self.arrays[f"cloud_{name}"] for name in CLOUDS}
        return Clouds(**columns, starts=self.arrays["starts"], sensor=self.arrays["sensor"])
