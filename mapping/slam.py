"""From scans to trajectory and map, one message at a time: front end, graph and grid put together.

A pure function of the messages it is given: no clock, no randomness, and searches in the background count from a fixed
keyframe on. A recording therefore replays to the same map, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.background import Background, at_once
from mapping.errors import MappingError
from mapping.front_end import FrontEnd, FrontEndSettings, KeyframeSettings, MappingCounters, TrackedScan
from mapping.graph_slam import GraphSettings, GraphSlam
from mapping.graph_state import GraphState
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.live_grid import LiveGrid
from mapping.mount import Mount
from mapping.odometry import OdometrySettings, ScanMatch
from mapping.sensor_models import LidarModel
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]
_SAME_PLACE_M = 0.005


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """Everything that decides what the map of given messages looks like."""

    resolution_m: float = 0.05
    odometry: OdometrySettings = OdometrySettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    graph: GraphSettings = GraphSettings()
    lidar_model: LidarModel = LidarModel()
    use_wheel_odometry: bool = True
    wheels_only: bool = False  # poses from wheel odometry alone: a baseline to compare scan matching with
    wheel_wait_s: float = 0.5
    scan_every: int = 1  # only every n-th scan is mapped: the thesis's scan rate T (table 4.1)


@dataclass(frozen=True, slots=True, eq=False)
class MappedScan:
    """A scan after mapping: poses (3,) of base_link in the map, as known then, and in the odom frame, at stamp_ns.

    points (N, 2) are its de-skewed measurements in the body frame. in_map: whether the pose hangs together with the
    beginning of the map; after a loss of tracking it is a guess until a loop is closed.
    """

    stamp_ns: int
    pose: FloatArray
    match: ScanMatch
    points: FloatArray
    wheel_guess: bool
    is_keyframe: bool
    in_map: bool = True

    @property
    def T_map_odom(self) -> FloatArray:  # noqa: N802 - the name says which frames
        """The odom frame's pose (3,) in the map: it jumps where a loop closes, the pose in odom never does."""
        return se2.compose(self.pose, se2.inverse(self.match.pose))


class Mapper:
    """SLAM for one robot; background decides where loops are searched for.

    live: `live_grid` is the map at any time. Else it is None: only `grid` draws one. resumed_ns: the end of the drive
    that it goes on from.
    """

    def __init__(
        self, settings: MappingSettings, mount: Mount, background: Background = at_once, *, live: bool = False
    ) -> None:
        self.mount = mount
        self._settings = settings
        self._front = FrontEnd(
            FrontEndSettings(
                settings.odometry, settings.keyframes, settings.use_wheel_odometry, settings.wheels_only,
                settings.wheel_wait_s,
            ),
            mount,
        )  # fmt: skip
        self.graph = GraphSlam(settings.graph, self._front.keyframes, background)
        self.live_grid = (
            LiveGrid(settings.resolution_m, settings.lidar_model, mount.pose[:2], background) if live else None
        )
        self._received = 0
        self.resumed_ns: int | None = None

    def resume(self, state: GraphState) -> None:
        """Go on from an earlier drive, before the first message; raises MappingError where its laser sat elsewhere."""
        off_m = float(np.hypot(*(state.clouds.sensor - self.mount.pose[:2])))
        if off_m > _SAME_PLACE_M:
            raise MappingError(
                f"the laser of the run to go on from sat {off_m:.2f} m from where this one sits: use its configuration"
            )
        self.graph.restore(state)
        self._front.resume()
        if self.live_grid is not None:
            self.live_grid.resume(self.graph)
        self.resumed_ns = state.end_ns

    @property
    def counters(self) -> MappingCounters:
        """What became of the scans."""
        return self._front.counters

    def add_odometry(self, message: Odometry) -> list[MappedScan]:
        """Take in wheel odometry; return the scans that had waited for it."""
        return self._enter(self._front.add_odometry(message))

    def add_scan(self, scan: LaserScan) -> list[MappedScan]:
        """Take in a scan; return what could be mapped: it waits while wheel odometry for its time is on the way."""
        if self.resumed_ns is not None and scan.stamp_ns <= self.resumed_ns:
            raise MappingError(
                "the scans are older than the end of the run to go on from: is the clock of this computer set?"
            )
        self._received += 1
        if (self._received - 1) % self._settings.scan_every:
            return []
        return self._enter(self._front.add_scan(scan))

    def finish(self) -> list[MappedScan]:
        """Map what still waits and close the last loops; call once after the last message."""
        mapped = self._enter(self._front.finish())
        self.graph.finish()
        return mapped

    def refine(self, cancelled: Callable[[], bool] = lambda: False) -> bool:
        """Refine the whole map after `finish`; False if cancelled on the way, with everything as it was."""
        return self.graph.refine(cancelled)

    @property
    def trajectory(self) -> Trajectory:
        """The poses of base_link in the map, as they are known by now."""
        return self.graph.trajectory()

    def grid(self) -> OccupancyGrid:
        """The occupancy grid of all kept scans at their present poses."""
        builder = GridBuilder(self._settings.resolution_m, self._settings.lidar_model)
        for pose, points in self.graph.placed_scans():
            builder.add_scan(se2.transform_points(pose, self.mount.pose[:2]), se2.transform_points(pose, points))
        return builder.grid()

    def _enter(self, tracked: list[TrackedScan]) -> list[MappedScan]:
        mapped = []
        for scan in tracked:
            pose = self.graph.add(scan)
            if self.live_grid is not None:
                self.live_grid.add(self.graph)
            kind = (scan.wheel_guess, scan.keyframe is not None, self.graph.is_tied)
            mapped.append(MappedScan(scan.stamp_ns, pose, scan.match, scan.points, *kind))
        return mapped
