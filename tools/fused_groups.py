"""What becomes of maps that are fused: the global maps, and what was decided of each pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fusion.alignment import Alignment
from fusion.certainty import CertaintyGrid
from fusion.hierarchy import LevelMap
from fusion.map_graph import Structure
from fusion.map_set import MapSet
from tools.pair_registration import Pair
from tools.results import FloatArray, Report


@dataclass(frozen=True, slots=True, eq=False)
class GlobalMap:
    """A group's evidence, and for each of its maps the pose of its frame (3,) and the covariance (3, 3) of that."""

    cells: CertaintyGrid
    T_global_map: Mapping[str, FloatArray]
    covariance: Mapping[str, FloatArray | None]


@dataclass(frozen=True, slots=True, eq=False)
class FusedGroups:
    """The global maps, the one with the best reference first; registrations that count; what was withdrawn, and why.

    details: more for the report. merged: the maps of the last level, where they were merged in levels.
    """

    groups: Sequence[GlobalMap]
    alignments: Mapping[Pair, tuple[Alignment, float]]
    withdrawn: Mapping[Pair, str] = field(default_factory=dict)
    details: Report = field(default_factory=dict)
    merged: Sequence[LevelMap] = ()

    def group_of(self, name: str) -> tuple[int, GlobalMap]:
        """Return number and global map of the group that a map is in."""
        return next((k, group) for k, group in enumerate(self.groups) if name in group.T_global_map)


def global_maps(maps: MapSet, structure: Structure) -> list[GlobalMap]:
    """Return the global map of each group of a structure."""
    return [
        GlobalMap(
            maps.fused(group),
            {name: each.T_group_map for name, each in group.maps.items()},
            {name: each.covariance for name, each in group.maps.items()},
        )
        for group in structure.groups
    ]
