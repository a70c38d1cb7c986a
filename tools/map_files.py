"""Map files as `fuse` takes them: what can be read of them, and which of them are one map."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fusion.identity import content_corner, content_hash, same_evidence
from mapping import se2
from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from tools.map_names import short_names
from tools.map_reading import read_saved
from tools.pair_cache import exact_hash
from tools.results import FloatArray

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class MapFiles:
    """What was read of files: grids by the number of the file, why others are skipped, and the maps that these are.

    maps: one of each content, by a name that its content gives it; name_of: the map that a file holds.
    """

    files: Sequence[Path]
    grids: Mapping[int, OccupancyGrid]
    skipped: Mapping[int, str]
    maps: Mapping[str, OccupancyGrid]
    name_of: Mapping[int, str]

    def first_of(self, name: str) -> int:
        """Return the number of the first file that holds a map."""
        return min(number for number, each in self.name_of.items() if each == name)

    def title(self, name: str) -> str:
        """Return the first file that holds a map."""
        return str(self.files[self.first_of(name)])

    def titles(self) -> dict[str, str]:
        """Return the title of each map."""
        return {name: self.title(name) for name in self.maps}

    def short_titles(self) -> dict[str, str]:
        """Return a short name of each map, none twice."""
        names = short_names(self.files)
        return {name: names[self.first_of(name)] for name in self.maps}

    def pose_in_group(self, number: int, T_group_map: FloatArray) -> FloatArray:
        """Return the pose (3,) of a file's frame, of that of its map: files of one map may have other frames."""
        grid, of_map = self.grids[number], self.maps[self.name_of[number]]
        if grid is of_map:
            return T_group_map
        T_map_file = se2.compose(content_corner(of_map), se2.inverse(content_corner(grid)))
        return se2.compose(T_group_map, T_map_file)


def read_maps(files: Sequence[Path]) -> MapFiles:
    """Read map files; raises MapFileError where none can be read. What is skipped is told."""
    grids, skipped, errors = dict[int, OccupancyGrid](), dict[int, str](), list[MapFileError]()
    for number, path in enumerate(files):
        try:
            grid = read_saved(path)
        except MapFileError as error:
            errors.append(error)
            skipped[number] = str(error)
            continue
        if grid.known.any():
            grids[number] = grid
        else:
            skipped[number] = f"{path}: no known cell"
    if len(errors) == len(files):
        raise errors[0] if len(errors) == 1 else MapFileError(f"none of {len(errors)} maps can be read: {errors[0]}")
    for reason in skipped.values():
        log.warning("%s: skipped", reason)
    return _by_content(files, grids, skipped)


def _by_content(files: Sequence[Path], grids: Mapping[int, OccupancyGrid], skipped: Mapping[int, str]) -> MapFiles:
    """Name maps by their content; of files of one content the one whose cells and frame come first stands for all."""
    ordered = sorted(grids, key=lambda number: exact_hash(grids[number]))
    maps: dict[str, OccupancyGrid] = {}
    name_of: dict[int, str] = {}
    for number in ordered:
        name = content_hash(grids[number])
        while name in maps and not same_evidence(maps[name], grids[number]):
            name += "'"  # maps of a few cells, which are alike by chance
        maps.setdefault(name, grids[number])
        name_of[number] = name
    return MapFiles(files, grids, skipped, maps, name_of)
