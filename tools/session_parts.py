"""What goes along with a live session: it is told of what comes and of each pose, and has its say in the report.

The car that is driven, the place on a saved map, a service manager: the session itself knows none of them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from drivers.messages import Recordable
from mapping.grid import OccupancyGrid
from mapping.mount import Mount
from mapping.slam import MappedScan
from mapping.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class LiveSession:
    """What a part is told when the sensors are started.

    clock: returns stamps in ns. mount: where the scans are taken from, on the car. put: records a message. stop: ends
    the session. grid_now: returns the map with all scans so far, in the thread that maps; only where a part needs it
    (SessionPart.needs_map). folder: where the results go. trajectory_now: the poses so far, likewise.
    """

    clock: Callable[[], int]
    mount: Mount
    put: Callable[[Recordable], None]
    stop: threading.Event
    grid_now: Callable[[], OccupancyGrid] | None = None
    folder: Path | None = None
    trajectory_now: Callable[[], Trajectory] | None = None


class SessionPart(Protocol):
    """What goes along. Its calls come in the thread that maps, but note's.

    tells: it says in the log how things stand, so that the session need not. needs_map: it wants the map at any time.
    hurries: old scans are of no use to it; where mapping is too slow for all, some are left out.
    """

    tells: bool
    needs_map: bool
    hurries: bool

    def begin(self, session: LiveSession) -> None:
        """The sensors are started."""
        ...

    def note(self, message: Recordable) -> None:
        """Take note of what came from a sensor, in the thread that reads it: return at once."""
        ...

    def add(self, mapped: MappedScan) -> None:
        """Take in a scan that was mapped."""
        ...

    def end(self) -> None:
        """The session is over, whatever ended it; the recording is still open."""
        ...

    def save(self, folder: Path) -> dict[str, Any]:
        """Write what is to be kept; return entries for report.json."""
        ...


@contextmanager
def going_along(parts: Sequence[SessionPart], session: LiveSession) -> Iterator[None]:
    """Begin all parts, and end each that has begun, the last first, whatever happens."""
    with ExitStack() as begun:
        for part in parts:
            begun.callback(part.end)
            part.begin(session)
        yield
