"""The maps that planning is tried on: map files, those that a list of problems names, and what data folders hold."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from drivers.wording import fault_in
from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_image import decode_image, to_log_odds
from mapping.map_io import read_map
from mapping.map_yaml import MapMode, MapYaml, read_map_yaml
from tools.errors import ToolError
from tools.plan_problems import map_beside, read_problems
from tools.real_maps import HALMSTAD_M_PER_PX, read_text_grid

log = logging.getLogger(__name__)
_TABLET_MAPS = "pseudo_occupancy/*.png"  # of the Halmstad set: images without a YAML
_CORRIDORS = "LongCorridor*.txt"  # of the Merced set
_CORRIDOR_M_PER_PX = 0.1  # the set states none: its corridors are then 1.7 m wide


def map_files(sources: Iterable[Path]) -> list[Path]:
    """Return the map files that sources name: maps, lists of problems (.json), and folders, searched to the bottom.

    Raises ToolError where a source names none.
    """
    found: list[Path] = []
    for source in sources:
        if source.is_dir():
            globs = ("*.yaml", _TABLET_MAPS, _CORRIDORS)
            of_source = sorted(file for glob in globs for file in source.rglob(glob) if _is_map(file))
        elif source.suffix == ".json":
            of_source = [map_beside(source, name) for name in read_problems(source)]
        else:
            of_source = [source]
        if not of_source:
            raise ToolError(f"{source}: no map in it: name maps (.yaml, .npz), a problems.json, or a folder of maps")
        found += of_source
    return list(dict.fromkeys(found))


def read_any_map(file: Path) -> OccupancyGrid:
    """Read a map file, also one of a data set without a YAML; raises MapFileError and ToolError."""
    if file.suffix == ".txt":
        return read_text_grid(file, _CORRIDOR_M_PER_PX)
    building = file.stem.partition("_")[0]
    if file.suffix == ".png" and building in HALMSTAD_M_PER_PX:
        settings = MapYaml(file, MapMode.TRINARY, HALMSTAD_M_PER_PX[building], (0.0, 0.0, 0.0))
        try:
            cells, _ = to_log_odds(*decode_image(file.read_bytes(), file), settings)
        except OSError as error:
            raise ToolError(f"{file}: {fault_in(error)}") from error
        return OccupancyGrid(cells, settings.resolution_m, np.zeros(3))
    return read_map(file)


def _is_map(file: Path) -> bool:
    """Whether a file of a folder can be read as a map; one whose image is missing is told of."""
    if file.suffix != ".yaml":
        return file.is_file()
    try:
        image = read_map_yaml(file).image
    except MapFileError:
        return False  # some other YAML
    if not image.is_file():
        log.warning("%s: left out: its image %s is not there", file, image.name)
    return image.is_file()
