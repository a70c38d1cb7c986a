"""The one data flow, for live runs and replays alike: messages in, trajectory and map out.

This is the only place that picks the concrete parts. Nothing in it depends on when it is called, so the same messages
give the same map; only the stopwatch for the report looks at a clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from drivers.messages import DepthImage, LaserScan, LidarStream, Message, Odometry, RawChunk, Transform
from drivers.rplidar_decoder import DecoderCounters, RplidarDecoder, load_compiled
from mapping.background import Background, at_once
from mapping.depth_grid import add_grids
from mapping.depth_projection import CameraMount
from mapping.frames import find_mount, find_pose
from mapping.graph_slam import GraphSettings
from mapping.graph_state import GraphState
from mapping.grid import OccupancyGrid
from mapping.hidden_sectors import hide_sectors
from mapping.loop_closure import LoopSettings
from mapping.mount import Mount
from mapping.slam import MappedScan, Mapper, MappingSettings
from mapping.sweep import TRIAL_SCANS, SweepVerdict, detect_sweep, reverse_sweep
from tools.config import Config
from tools.depth_flow import DepthFlow

LASER_FRAME = "laser"  # of our own driver
CAMERA_FRAME = "camera_depth_optical_frame"
BASE_FRAMES = ("base_link", "base_footprint")
_LOOK_AHEAD_CHUNKS = 200
_LOOK_AHEAD_IMAGES = 300  # of a recording in which no scan has come by then
_BACKGROUND_THREADS = 2  # a search for loops does not wait for a refinement

_T = TypeVar("_T")


class LidarDecoding:
    """Raw lidar bytes to scans; every other message passes through."""

    def __init__(self) -> None:
        self._decoder: RplidarDecoder | None = None
        self._ended: list[DecoderCounters] = []

    def feed(self, message: Message) -> list[Message]:
        """Return the scans that the message completes, or the message itself."""
        if isinstance(message, LidarStream):
            if self._decoder is not None:
                self._ended.append(self._decoder.counters)
            self._decoder = RplidarDecoder(message)
            return []
        if isinstance(message, RawChunk):
            return [] if self._decoder is None else list(self._decoder.feed(message))
        return [message]

    @property
    def counters(self) -> list[DecoderCounters]:
        """What each stream so far gave, in order."""
        return self._ended + ([] if self._decoder is None else [self._decoder.counters])


class MappingFlow:
    """Decoded messages to trajectory and map, with the time that each mapped scan took."""

    def __init__(
        self,
        config: Config,
        mount: Mount,
        *,
        sweep_reversed: bool = False,
        background: Background = at_once,
        resume: GraphState | None = None,
        live: bool = False,
        depth: DepthFlow | None = None,
    ) -> None:
        tracked = depth is not None and depth.tracks
        self.mapper = Mapper(config.mapping_settings(tracked=tracked), mount, background, live=live)
        if resume is not None:
            self.mapper.resume(resume)
        self.depth = depth
        self.refined = False
        self.scans = 0
        self._wants_refinement = config.slam.refine and config.odometry.source == "kiss" and not tracked
        self.seconds: list[float] = []
        self.finish_s = self.refine_s = 0.0
        self._sweep_reversed = sweep_reversed
        self._hidden, self._mount = config.hidden_sectors(), mount

    def feed(self, message: Message) -> list[MappedScan]:
        """Take in one message; return the scans that could be mapped with it."""
        started = time.perf_counter()
        if isinstance(message, DepthImage) and self.depth is not None:
            mapped = [scan for seen in self.depth.add_image(message) for scan in self._enter(seen)]
        else:
            if isinstance(message, LaserScan):
                message = hide_sectors(message, self._hidden, self._mount)
            mapped = self._enter(message)
        self._place_views(mapped)
        if mapped:
            self.seconds.append((time.perf_counter() - started) / len(mapped))
        return mapped

    def _enter(self, message: Message) -> list[MappedScan]:
        if isinstance(message, LaserScan):
            self.scans += 1
            return self.mapper.add_scan(reverse_sweep(message) if self._sweep_reversed else message)
        return self.mapper.add_odometry(message) if isinstance(message, Odometry) else []

    def finish(self) -> list[MappedScan]:
        """Map what still waits and close the last loops; call once after the last message."""
        started = time.perf_counter()
        mapped = self.mapper.finish()
        self._place_views(mapped)
        if self.depth is not None:
            self.depth.views.finish()
        self.finish_s = time.perf_counter() - started
        return mapped

    def refine(self, cancelled: Callable[[], bool] = lambda: False) -> bool:
        """Refine the map after `finish`, if the configuration asks for it; tell whether it was done."""
        started = time.perf_counter()
        self.refined = self._wants_refinement and self.mapper.refine(cancelled)
        self.refine_s = time.perf_counter() - started
        return self.refined

    def maps(self) -> dict[str, OccupancyGrid]:
        """Return all maps by name, as they are known by now: `map` first, that of the sensor that gives the poses.

        With a lidar and a camera also `depth_map`, what the camera saw from the lidar's poses, and `both_map`.
        """
        if self.depth is None:
            return {"map": self.mapper.grid()}
        seen = self.depth.grid(self.mapper.trajectory)
        if self.depth.alone:
            return {"map": seen}
        measured = self.mapper.grid()
        return {"map": measured, "depth_map": seen, "both_map": add_grids(measured, seen)}

    def _place_views(self, mapped: list[MappedScan]) -> None:
        if self.depth is not None:
            for scan in mapped:
                self.depth.views.add_pose(scan.stamp_ns, scan.match.pose)


@contextmanager
def search_thread() -> Iterator[Background]:
    """Yield a background in which other threads search for loops and refine the map, while the caller maps on."""
    with ThreadPoolExecutor(_BACKGROUND_THREADS, thread_name_prefix="slam") as executor:

        def begin(task: Callable[[], _T], /) -> Callable[[], _T]:
            return executor.submit(task).result

        yield begin


@dataclass(frozen=True, slots=True)
class Setup:
    """What must be known before the first scan: where laser and camera sit, and how the laser really sweeps."""

    mount: Mount
    mount_source: str
    sweep: SweepVerdict
    camera: CameraMount
    camera_source: str


def look_ahead(messages: Iterable[Message], config: Config) -> Setup:
    """Read the beginning of a recording for the sensors' poses, from /tf_static or else the config, and the sweep."""
    transforms: list[Transform] = []
    scans: list[LaserScan] = []
    base_frame, laser_frame, chunks = config.replay.base_frame, LASER_FRAME, 0
    camera_frame, images = CAMERA_FRAME, 0
    for message in messages:
        if isinstance(message, Transform) and message.static:
            transforms.append(message)
        elif isinstance(message, Odometry):
            base_frame = base_frame or message.child_frame_id
        elif isinstance(message, LidarStream):
            laser_frame = message.frame_id
        elif isinstance(message, LaserScan):
            laser_frame = message.frame_id
            scans.append(message)
        elif isinstance(message, DepthImage):
            camera_frame, images = message.frame_id, images + 1
        chunks += isinstance(message, RawChunk)
        if len(scans) >= TRIAL_SCANS or chunks >= _LOOK_AHEAD_CHUNKS or (images >= _LOOK_AHEAD_IMAGES and not scans):
            break
    mount, source = resolve_mount(transforms, config, base_frame, laser_frame)
    if chunks:
        sweep = SweepVerdict(is_reversed=False, reason="known, from raw bytes")
    elif config.replay.sweep == "auto":
        sweep = detect_sweep(scans, config.mapping_settings(), mount)
    else:
        sweep = SweepVerdict(is_reversed=config.replay.sweep == "reversed", reason="set in the configuration")
    camera, camera_source = resolve_camera_mount(transforms, config, base_frame, camera_frame)
    return Setup(mount, source, sweep, camera, camera_source)


def resolve_mount(
    transforms: list[Transform], config: Config, base_frame: str | None, laser_frame: str
) -> tuple[Mount, str]:
    """Return the laser's mount and where it was found."""
    for base in base_frames(base_frame):
        mount = find_mount(transforms, base, laser_frame)
        if mount is not None:
            return mount, f"/tf_static {base} -> {laser_frame}"
    return config.mount(), "config lidar.mount"


def resolve_camera_mount(
    transforms: list[Transform], config: Config, base_frame: str | None, camera_frame: str
) -> tuple[CameraMount, str]:
    """Return the depth camera's mount and where it was found."""
    for base in base_frames(base_frame):
        pose = find_pose(transforms, base, camera_frame)
        if pose is not None:
            return CameraMount.from_matrix4(pose), f"/tf_static {base} -> {camera_frame}"
    return config.camera_mount(), "config depth.mount"


def base_frames(first: str | None) -> tuple[str, ...]:
    """Return what the car's body may be called, the first choice in front."""
    return tuple(dict.fromkeys((first, *BASE_FRAMES))) if first else BASE_FRAMES


def warm_up() -> None:
    """Load all compiled code, also by mapping a few turns in a made-up room, so that no scan waits for the compiler.

    That takes part of a second, on the first run ever, which compiles, about a minute.
    """
    load_compiled()
    loops = LoopSettings(least_path_m=0.5, least_overlap=0.0, least_hit_share=0.0, most_rival=2.0)
    mapper = Mapper(MappingSettings(graph=GraphSettings(delay=4, loops=loops)), Mount())
    bearings = np.linspace(-np.pi, np.pi, 240, endpoint=False)
    for number in range(16):
        x = 0.3 * min(number, 16 - number)
        to_x = np.where(np.cos(bearings) > 0, 4.0 - x, 2.0 + x) / np.maximum(np.abs(np.cos(bearings)), 1e-9)
        to_y = np.where(np.sin(bearings) > 0, 2.0, 3.0) / np.maximum(np.abs(np.sin(bearings)), 1e-9)
        stamp_ns = (number + 1) * 300_000_000
        mapper.add_odometry(Odometry(stamp_ns, np.array([x, 0.0, 0.0]), np.zeros(3)))
        for later_ns in (0, 1_000_000):  # the second is no keyframe: such scans are refined too
            mapper.add_scan(LaserScan(stamp_ns + later_ns, bearings, np.minimum(to_x, to_y), np.zeros(240), 0.1, 12.0))
    mapper.finish()
    mapper.refine()
    mapper.grid()
