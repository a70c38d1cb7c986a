"""Maps of one environment by resolution and scan rate, as chapter 4 of the thesis takes them from its data set."""

from __future__ import annotations

from dataclasses import dataclass

from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.errors import ToolError
from tools.map_data_set import DataSetMap, MapDataSet


@dataclass(frozen=True, slots=True)
class HeterogeneousSet:
    """The maps of a set by (k, r): every k-th scan, r cells/m; both rise."""

    maps: dict[tuple[int, float], DataSetMap]
    every: tuple[int, ...]
    resolutions: tuple[float, ...]

    def of_rate(self, k: int) -> list[DataSetMap]:
        """Return the maps of one rate, by resolution."""
        return [self.maps[k, r] for r in self.resolutions if (k, r) in self.maps]

    def of_resolution(self, r: float) -> list[DataSetMap]:
        """Return the maps of one resolution, the highest rate first."""
        return [self.maps[k, r] for k in self.every if (k, r) in self.maps]

    def rate_name(self, k: int) -> str:
        """Return T in words."""
        rate_hz = next(each.rate_hz for (every, _), each in self.maps.items() if every == k)
        share = "every scan" if k == 1 else f"one scan in {k}"
        return share if rate_hz is None else f"T ≈ {rate_hz:.2f} Hz ({share})"


def heterogeneous_set(data: MapDataSet) -> HeterogeneousSet:
    """Return the maps of a set whose resolution and rate are known, of the first robot."""
    maps: dict[tuple[int, float], DataSetMap] = {}
    for each in data.maps:
        if each.scan_every is not None and each.robot == data.maps[0].robot:
            maps[each.scan_every, round(each.cells_per_meter, 6)] = each
    return HeterogeneousSet(maps, tuple(sorted({k for k, _ in maps})), tuple(sorted({r for _, r in maps})))


def lacks_resolutions(data: MapDataSet) -> str | None:
    """Say what a set lacks for a comparison of resolutions; None if nothing."""
    found = heterogeneous_set(data)
    if found.every and len(found.of_rate(found.every[0])) > 1:
        return None
    return "no two maps of one drive and scan rate at different resolutions: make them with --kind heterogeneous"


def lacks_rates(data: MapDataSet) -> str | None:
    """Say what a set lacks for a comparison of scan rates; None if nothing."""
    found = heterogeneous_set(data)
    if found.every and len(found.of_resolution(found.resolutions[-1])) > 1:
        return None
    return "no two maps of one drive and resolution at different scan rates: make them with --kind heterogeneous"


def grid_of(each: DataSetMap) -> OccupancyGrid:
    """Read a map; raises ToolError."""
    try:
        return read_map(each.path)
    except MapFileError as error:
        raise ToolError(str(error)) from error
