"""A folder in which a robot leaves its map again and again: which one is the newest, and whether it can be believed.

Polled, as a folder may lie on a network drive. Whatever happens to the file, the last good map is kept.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from fusion.identity import goes_on, known_area_m2
from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.map_yaml import read_map_yaml
from tools.errors import ToolError
from tools.map_folder import map_files, result_map
from tools.pair_cache import exact_hash
from tools.result_folder import REPORT

_PATIENCE = 2  # polls in a row for which a map must be gone or unreadable, and stand still, before that is told
_RESTLESS = 15  # polls in a row in which an image changes before that is told
_LOSSLESS = ".npz"
_GONE = (0, 0, 0)


class NewsKind(str, Enum):
    """What a poll found: a first map, a later version, a map begun anew, or a trouble with the files."""

    first = "first"
    grown = "grown"
    restarted = "restarted"
    trouble = "trouble"


@dataclass(frozen=True, slots=True, eq=False)
class RobotMap:
    """A robot's map as it was read: its file, cells, their hash; finished: its run has ended, it will not grow."""

    path: Path
    grid: OccupancyGrid
    hash: str
    finished: bool


@dataclass(frozen=True, slots=True, eq=False)
class News:
    """What a poll found, in words; map: the new one, None with trouble; former: that of a robot that started again."""

    kind: NewsKind
    text: str
    map: RobotMap | None = None
    former: RobotMap | None = None


@dataclass(frozen=True, slots=True)
class _Stamp:
    """A map's file, and name, inode, time and size of each file that it is made of."""

    path: Path
    files: tuple[tuple[str, int, int, int], ...]


class RobotFolder:
    """One robot's folder. map: its last good map, None before there is one."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.map: RobotMap | None = None
        self._taken: _Stamp | None = None  # of the map that was read last, good or the same as before
        self._seen: _Stamp | None = None  # at the last poll
        self._bad: _Stamp | None = None  # could not be read
        self._still, self._restless = 0, 0
        self._told = ""

    def poll(self) -> News | None:
        """Look at the folder once; return what is new, None where nothing is."""
        try:
            stamp = _stamp_of(newest_map(self.folder))
        except (ToolError, OSError):
            stamp = None
        self._still = self._still + 1 if stamp == self._seen else 0
        self._restless = 0 if stamp == self._seen else self._restless + 1
        self._seen = stamp
        if stamp is None:
            lost = self.map is not None and self._still >= _PATIENCE
            return self._trouble("its map is gone: the last one is kept") if lost else None
        if stamp == self._taken:
            self._told = ""
            return self._ended(stamp)
        return self._taken_up(stamp)

    def _taken_up(self, stamp: _Stamp) -> News | None:
        """Read a map that is new, unless it is still being written."""
        whole_at_once = stamp.path.suffix.lower() == _LOSSLESS  # its check sums tell
        if not whole_at_once and self._still == 0:
            if self._restless >= _RESTLESS:
                return self._trouble(
                    f"{stamp.path.name} changes at every look, so it may be half written: write it under another name "
                    "and rename it, or look less often"
                )
            return None
        if stamp == self._bad and self._still != _PATIENCE:
            return None
        try:
            grid = read_map(stamp.path)
            again = _stamp_of(stamp.path)
        except (MapFileError, OSError) as error:
            self._bad = stamp
            kept = "" if self.map is None else ": the last good one is kept"
            return self._trouble(f"{error}{kept}") if self._still >= _PATIENCE else None
        if again != stamp:
            return None  # replaced while it was read
        self._taken, self._bad = stamp, None
        if not grid.known.any():
            return self._trouble(f"{stamp.path.name} has no known cell")
        self._told = ""
        return self._compared(RobotMap(stamp.path, grid, exact_hash(grid), _has_ended(self.folder, stamp.path)))

    def _compared(self, new: RobotMap) -> News | None:
        """Return what a new map is beside the last one."""
        last, self.map = self.map, new
        area_m2 = known_area_m2(new.grid)
        if last is None:
            return News(NewsKind.first, f"first map, {area_m2:.0f} m²", new)
        if new.hash == last.hash:
            return News(NewsKind.grown, "its run has ended", new) if new.finished and not last.finished else None
        was_m2 = known_area_m2(last.grid)
        if goes_on(new.grid, last.grid):
            return News(NewsKind.grown, f"{area_m2:.0f} m² (was {was_m2:.0f})", new)
        return News(
            NewsKind.restarted,
            f"another map, {area_m2:.0f} m², without most of the last one's {was_m2:.0f} m²: the robot started again",
            new,
            last,
        )

    def _ended(self, stamp: _Stamp) -> News | None:
        """Tell of the end of a run whose map is the one that was read already."""
        if self.map is None or self.map.finished or self.map.path != stamp.path:
            return None
        if not _has_ended(self.folder, stamp.path):
            return None
        self.map = replace(self.map, finished=True)
        return News(NewsKind.grown, "its run has ended", self.map)

    def _trouble(self, text: str) -> News | None:
        """Return a trouble once, not at every poll."""
        if text == self._told:
            return None
        self._told = text
        return News(NewsKind.trouble, text)


def newest_map(folder: Path) -> Path | None:
    """Return the newest map of a robot's folder, by the time of its files; None where there is none. ToolError."""
    own = result_map(folder)
    if own is not None:
        return own
    found = map_files(entry for entry in folder.iterdir() if not entry.name.startswith("."))
    return max(found, key=lambda path: (_time_of(path), path.name), default=None)


def _time_of(path: Path) -> int:
    stamp = _stamp_of(path)
    return 0 if stamp is None else max(time_ns for _, _, time_ns, _ in stamp.files)


def _stamp_of(path: Path | None) -> _Stamp | None:
    """Return what tells a map's files from others of their names; None where there is none."""
    if path is None:
        return None
    files = [path]
    if path.suffix.lower() != _LOSSLESS:
        with suppress(MapFileError):  # reading the map will say what is wrong
            files.append(read_map_yaml(path).image)
    states = [_state_of(file) for file in files]
    return None if states[0][1:] == _GONE else _Stamp(path, tuple(states))


def _state_of(file: Path) -> tuple[str, int, int, int]:
    try:
        state = file.stat()
    except OSError:
        return (file.name, *_GONE)
    return file.name, state.st_ino, state.st_mtime_ns, state.st_size


def _has_ended(folder: Path, path: Path) -> bool:
    """Tell whether a map is that of a run that has ended, which leaves its report last."""
    return result_map(folder) == path and (folder / REPORT).is_file()
