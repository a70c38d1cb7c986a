"""Short names of map files, none twice: for pictures, and for files about the robots that made the maps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

DRIVE_MAPS = ("map", "depth_map", "both_map")  # what `run` and `replay` call their maps: the folder says which drive


def map_title(file: Path) -> str:
    """Return what a map is called: its file without the ending; of a map of `run` or `replay` the folder."""
    return plain(file.resolve().parent.name if file.stem in DRIVE_MAPS else file.stem)


def short_names(files: Sequence[Path]) -> list[str]:
    """Return the title of each file; of alike ones with the folder before it; numbered, if that is not enough."""
    titles = [map_title(file) for file in files]
    return distinct(titles, [f"{file.resolve().parent.name}-{file.stem}" for file in files])


def distinct(short: Sequence[str], long: Sequence[str]) -> list[str]:
    """Return the short names, the long ones in place of those that several have; numbered, if that is not enough."""
    names = [one if short.count(one) == 1 else plain(other) for one, other in zip(short, long, strict=True)]
    return names if len({*names}) == len(names) else [f"{number}-{name}" for number, name in enumerate(names, start=1)]


def plain(name: str) -> str:
    """Return a name that is a good part of a file's name."""
    return re.sub(r"[^\w.-]+", "-", name).strip("-.") or "map"
