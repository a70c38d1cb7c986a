"""The kinds of map data sets, by the name that `data-set --kind` takes."""

from __future__ import annotations

from types import MappingProxyType

from tools.data_set_plan import DataSetKind
from tools.growing_maps import growing_maps
from tools.halmstad_maps import halmstad_maps
from tools.heterogeneous_maps import heterogeneous_maps
from tools.overlapping_parts import overlapping_parts
from tools.robot_maps import robot_maps

KINDS: MappingProxyType[str, DataSetKind] = MappingProxyType(
    {
        "heterogeneous": DataSetKind("one environment at several resolutions and scan rates", heterogeneous_maps),
        "parts": DataSetKind("two parts that overlap, each at several resolutions", overlapping_parts),
        "robots": DataSetKind("each robot's part of a building, at its resolution and scan rate", robot_maps),
        "halmstad": DataSetKind("tablet maps of a building of the Halmstad data set, with its layout", halmstad_maps),
        "growing": DataSetKind("two robots' maps while they drive, one of each a step", growing_maps, (1, 2)),
    }
)
