"""The maps in a folder, as commands take a folder for them: one level deep, each map once."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from tools.errors import ToolError
from tools.result_folder import RECORDING, REPORT

log = logging.getLogger(__name__)

RESULT = "map"  # the stem of the map that `run` and `replay` leave
_YAML, _LOSSLESS = (".yaml", ".yml"), ".npz"
_NAMES_IMAGE = re.compile(rb"^\s*[\"']?image[\"']?\s*:", re.MULTILINE)
_OLDER_S = 10.0  # a lossless file that is so much older than the image beside it is of another map


def expanded(arguments: Sequence[Path]) -> list[Path]:
    """Return map files, each folder replaced by the maps in it; raises ToolError for a folder without any."""
    files: list[Path] = []
    for path in arguments:
        if not path.is_dir():
            files.append(path)
            continue
        found = maps_in(path)
        if not found:
            raise ToolError(
                f"{path}: no map in it: expected .yaml files that name an image, .npz files, or folders of `run` or"
                " `replay`"
            )
        log.info("%s: %d map%s", path, len(found), "" if len(found) == 1 else "s")
        files += found
    return files


def maps_in(folder: Path) -> list[Path]:
    """Return the maps in a folder, by name: its map files, and the map of each subfolder that `run` or `replay` left.

    A folder of theirs is one map itself. A .yaml file counts if it names an image or another file of its name lies
    beside it; of a YAML and an .npz of one name, which are one map, the .npz counts, as it is lossless. Raises
    ToolError.
    """
    entries = _entries(folder)
    own = result_map(folder)
    if own is not None:
        return [own]
    found = map_files(entries)
    for entry in entries:
        if entry.suffix.lower() in _YAML and entry.stem not in {each.stem for each in found}:
            log.info("%s: names no image, so it is no map: left out", entry)
    results = (result_map(entry) for entry in entries if entry.is_dir())
    return sorted([*found, *(each for each in results if each is not None)])


def result_map(folder: Path) -> Path | None:
    """Return the map of a folder that `run` or `replay` left, or is writing; None for any other folder."""
    entries = {entry.name: entry for entry in _entries(folder)}
    if not {REPORT, RECORDING, "trajectory.tum"} & set(entries):
        return None
    found = map_files(entry for name, entry in entries.items() if Path(name).stem == RESULT)
    return found[0] if found else None


def map_files(entries: Iterable[Path]) -> list[Path]:
    """Return those of the files of one folder that are maps, each map once, by name."""
    stems: dict[str, list[Path]] = {}
    for entry in sorted(entries):
        stems.setdefault(entry.stem, []).append(entry)
    return [each for files in stems.values() for each in _maps_of_stem(files)]


def _maps_of_stem(files: Sequence[Path]) -> list[Path]:
    """Return the map files among the files of one name."""
    lossless = [each for each in files if each.suffix.lower() == _LOSSLESS and each.is_file()]
    described = [each for each in files if each.suffix.lower() in _YAML and each.is_file()]
    if len(files) == 1:
        described = [each for each in described if _names_image(each)]
    if lossless and described:
        newest = max(each.stat().st_mtime for each in files)
        return lossless if lossless[0].stat().st_mtime >= newest - _OLDER_S else described
    return lossless or described


def _names_image(path: Path) -> bool:
    """Tell whether a YAML file is meant as a map's; an empty one, as an interrupted writer leaves, may be."""
    try:
        content = path.read_bytes()
    except OSError:
        return True  # reading it will say why
    return not content.strip() or _NAMES_IMAGE.search(content) is not None


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        reason = error.strerror or error
        raise ToolError(f"{folder}: cannot be listed: {reason}: check the name and its permissions") from error
