"""Map files for commands: what is odd about them goes to the log."""

from __future__ import annotations

import logging
from pathlib import Path

from mapping.grid import OccupancyGrid
from mapping.map_io import read_map_with_warnings

log = logging.getLogger(__name__)


def read_saved(map_file: Path) -> OccupancyGrid:
    """Read a map; what is odd about it goes to the log. Raises MapFileError."""
    loaded = read_map_with_warnings(map_file)
    for warning in loaded.warnings:
        log.warning("%s", warning)
    return loaded.grid
