"""The map while the robot drives: it grows with every scan, and is drawn anew beside once loops have moved its walls.

Mapping does not wait for that: another thread draws all scans where they belong by now, catches up with those that came
meanwhile, and only then takes the place of the old map. The map that is saved in the end is drawn from all scans.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.background import Background, at_once
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.scan_archive import PlacedScans
from mapping.sensor_models import LidarModel

FloatArray = NDArray[np.float64]

_FAR_M = 5.0  # a wall so far away shows by how much a turn moves the map
_SCANS_A_KEYFRAME = 100  # a background that draws fewer, while the robot goes on to its next keyframe, is too slow
_AT_ONCE = 20  # so few scans are drawn while mapping waits
_REST = 2  # drawing anew takes up again after the drive has grown by one part in so many


class Graph(Protocol):
    """What is followed: keyframes (K, 3) in the map, and the scans on them."""

    @property
    def keyframe_poses(self) -> FloatArray:
        """The poses (K, 3), another array once they have changed."""
        ...

    def placed(self) -> PlacedScans:
        """Return all scans where they lie now."""
        ...


@dataclass(slots=True, eq=False)
class _Drawing:
    """A map under way: drawn[k] (3,) is where keyframe k was when its scans were drawn, nan where they were not."""

    builder: GridBuilder
    drawn: list[FloatArray]
    scans: int = 0


class LiveGrid:
    """Follows a graph; sensor (2,) is the laser's position in the body frame."""

    def __init__(
        self, resolution_m: float, model: LidarModel, sensor: FloatArray, background: Background = at_once
    ) -> None:
        self.redrawn = 0
        self._resolution_m = resolution_m
        self._model = model
        self._sensor = sensor
        self._background = background
        self._shown = self._blank()
        self._next: _Drawing | None = None
        self._task: Callable[[], None] | None = None
        self._due = 0  # the keyframe at which the background must be done
        self._rest_until = 0  # the keyframe before which nothing is drawn anew
        self._placed: PlacedScans | None = None  # as of the last keyframe; poses change with keyframes only

    def resume(self, graph: Graph) -> None:
        """Leave what is there by now to the background, before the first scan: of a long drive it takes seconds."""
        placed = graph.placed()
        self._shown.scans = len(placed)
        self._shown.drawn = [np.full(3, np.nan)] * len(placed.poses)

    def add(self, graph: Graph) -> None:
        """Draw the last scan that the graph has taken in; call after each."""
        if self._placed is None or len(graph.keyframe_poses) != len(self._placed.poses):
            self._placed = graph.placed()
            self._renew(self._placed)
        self._draw(self._shown, self._placed, len(self._placed))

    def grid(self) -> OccupancyGrid:
        """Return the map as it is shown now."""
        return self._shown.builder.grid()

    def _renew(self, placed: PlacedScans) -> None:
        """Begin to draw anew where the map has moved, or go on with it once the background must be done."""
        keyframes = len(placed.poses)
        if self._next is None:
            has_rested = keyframes >= self._rest_until
            if self._lacks_a_piece(placed) or (has_rested and self._has_moved(placed)):
                self._rest_until = keyframes + keyframes // _REST
                self._next = self._blank()
                self._hand_over(self._next, placed)
        elif keyframes >= self._due:
            self._wait()
            if len(placed) - self._next.scans > _AT_ONCE:
                self._hand_over(self._next, placed)
                return
            self._draw(self._next, placed, len(placed) - 1)  # the last one comes next
            self._shown, self._next = self._next, None
            self.redrawn += 1

    def _hand_over(self, drawing: _Drawing, placed: PlacedScans) -> None:
        """Let the background draw all that is there by now."""
        frozen = placed.copy()
        self._due = len(placed.poses) + 1 + (len(placed) - drawing.scans) // _SCANS_A_KEYFRAME
        self._task = self._background(lambda: self._draw(drawing, frozen, len(frozen)))

    def _wait(self) -> None:
        task, self._task = self._task, None
        if task is not None:
            task()

    def _lacks_a_piece(self, placed: PlacedScans) -> bool:
        """Whether keyframes whose place is known by now were left out, or drawn where their place is not known."""
        drawn = np.array(self._shown.drawn).reshape(-1, 3)
        return bool((np.isnan(drawn[:, 0]) == placed.in_map[: len(drawn)]).any())

    def _has_moved(self, placed: PlacedScans) -> bool:
        """Whether a keyframe lies elsewhere than where its scans were drawn, by half a cell."""
        drawn = np.array(self._shown.drawn).reshape(-1, 3)
        in_map = placed.in_map[: len(drawn)]
        off = se2.between(drawn[in_map], placed.poses[: len(drawn)][in_map])
        moved = np.hypot(off[:, 0], off[:, 1]) + _FAR_M * np.abs(off[:, 2])
        return bool(moved.max(initial=0.0) > 0.5 * self._resolution_m)

    def _draw(self, drawing: _Drawing, placed: PlacedScans, until: int) -> None:
        """Draw the scans that are not drawn yet, up to number `until`."""
        for number in range(len(drawing.drawn), len(placed.poses)):
            drawing.drawn.append(placed.poses[number] if placed.in_map[number] else np.full(3, np.nan))
        for number in range(drawing.scans, until):
            scan = placed.get(number)
            if scan is not None:
                pose, points = scan
                drawing.builder.add_scan(se2.transform_points(pose, self._sensor), se2.transform_points(pose, points))
        drawing.scans = until  # fewer than before where scans were taken back

    def _blank(self) -> _Drawing:
        return _Drawing(GridBuilder(self._resolution_m, self._model), [])
