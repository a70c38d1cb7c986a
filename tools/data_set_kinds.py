"""The kinds of map data sets, by the name that `data-set --kind` takes."""

from __future__ import annotations

from types import MappingProxyType

from tools.data_set_plan import DataSetKind
from tools.growing_maps import growing_maps
from tools.heterogeneous_maps import heterogeneous_maps

KINDS: MappingProxyType[str, DataSetKind] = MappingProxyType(
    {
        "heterogeneous": DataSetKind("one environment at several resolutions and scan rates", heterogeneous_maps),
        "growing": DataSetKind("two robots' maps while they drive, one of each a step", growing_maps, (1, 2)),
    }
)
