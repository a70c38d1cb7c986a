"""Map and trajectory of a run that goes on, written now and then for others: `fuse --watch` merges robots' maps.

Written by another thread, whole or not at all; mapping does not wait, and goes on where the disk is full.
"""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import Any

from typing_extensions import override

from drivers.messages import Recordable
from mapping.errors import MapFileError, TrajectoryError
from mapping.grid import OccupancyGrid
from mapping.map_io import write_lossless
from mapping.slam import MappedScan
from mapping.trajectory import Trajectory, write_tum
from tools.session_parts import LiveSession, SessionPart

log = logging.getLogger(__name__)
SHARED_NAME, TRACK_NAME = "map.npz", "trajectory.tum"  # as the run leaves them in the end


class SharedMap(SessionPart):
    """Writes trajectory.tum and map.npz into the run's folder every so many seconds of the drive."""

    tells = False
    needs_map = True
    hurries = False

    def __init__(self, every_s: float) -> None:
        self._every_ns = round(every_s * 1e9)
        self._session: LiveSession | None = None
        self._written_ns: int | None = None
        self._writer: threading.Thread | None = None
        self._told = False

    @override
    def begin(self, session: LiveSession) -> None:
        """The sensors are started."""
        assert session.grid_now is not None
        assert session.trajectory_now is not None
        assert session.folder is not None
        self._session = session

    def note(self, message: Recordable) -> None:
        """What comes from a sensor is no map yet."""

    def add(self, mapped: MappedScan) -> None:
        """Hand over the map to the writer, if it is time and the last one is written."""
        if self._written_ns is None:
            self._written_ns = mapped.stamp_ns
        busy = self._writer is not None and self._writer.is_alive()
        if busy or mapped.stamp_ns - self._written_ns < self._every_ns:
            return
        session = self._session
        assert session is not None
        assert session.grid_now is not None
        assert session.trajectory_now is not None
        assert session.folder is not None
        self._written_ns = mapped.stamp_ns
        self._writer = threading.Thread(
            target=self._write,
            args=(session.folder, session.grid_now(), session.trajectory_now()),
            name="shared map",
            daemon=True,
        )
        self._writer.start()

    def end(self) -> None:
        """Wait for the writer: what the run saves comes after it."""
        if self._writer is not None:
            self._writer.join()

    @override
    def save(self, folder: Path) -> dict[str, Any]:
        """Nothing more is kept."""
        return {}

    def _write(self, folder: Path, grid: OccupancyGrid, trajectory: Trajectory) -> None:
        try:
            partial = folder / f"{TRACK_NAME}.part"
            write_tum(partial, trajectory)
            partial.replace(folder / TRACK_NAME)
            write_lossless(folder / SHARED_NAME, grid, provenance={"source": "a run that goes on"})
        except (MapFileError, TrajectoryError, OSError) as error:
            if not self._told:
                log.warning("%s: the map is not shared: %s", folder, getattr(error, "strerror", None) or error)
            self._told = True
