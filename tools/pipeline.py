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

from drivers.messages import LaserScan, LidarStream, Message, Odometry, RawChunk, Transform
from drivers.rplidar_decoder import DecoderCounters, RplidarDecoder
from mapping.background import Background, at_once
from mapping.frames import find_mount
from mapping.graph_slam import GraphSettings
from mapping.graph_state import GraphState
from mapping.loop_closure import LoopSettings
from mapping.mount import Mount
from mapping.slam import MappedScan, Mapper, MappingSettings
from mapping.sweep import TRIAL_SCANS, SweepVerdict, detect_sweep, reverse_sweep
from tools.config import Config

LASER_FRAME = "laser"  # of our own driver
BASE_FRAMES = ("base_link", "base_footprint")
_LOOK_AHEAD_CHUNKS = 200
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
    ) -> None:
        self.mapper = Mapper(config.mapping_settings(), mount, background, live=live)
        if resume is not None:
            self.mapper.resume(resume)
        self.refined = False
        self.scans = 0
        self._wants_refinement = config.slam.refine and config.odometry.source != "wheel"
        self.seconds: list[float] = []
        self.finish_s = self.refine_s = 0.0
        self._sweep_reversed = sweep_reversed

    def feed(self, message: Message) -> list[MappedScan]:
        """Take in one message; return the scans that could be mapped with it."""
        started = time.perf_counter()
        if isinstance(message, LaserScan):
            self.scans += 1
            mapped = self.mapper.add_scan(reverse_sweep(message) if self._sweep_reversed else message)
        elif isinstance(message, Odometry):
            mapped = self.mapper.add_odometry(message)
        else:
            return []
        if mapped:
            self.seconds.append((time.perf_counter() - started) / len(mapped))
        return mapped

    def finish(self) -> list[MappedScan]:
        """Map what still waits and close the last loops; call once after the last message."""
        started = time.perf_counter()
        mapped = self.mapper.finish()
        self.finish_s = time.perf_counter() - started
        return mapped

    def refine(self, cancelled: Callable[[], bool] = lambda: False) -> bool:
        """Refine the map after `finish`, if the configuration asks for it; tell whether it was done."""
        started = time.perf_counter()
        self.refined = self._wants_refinement and self.mapper.refine(cancelled)
        self.refine_s = time.perf_counter() - started
        return self.refined


@contextmanager
def search_thread() -> Iterator[Background]:
    """Yield a background in which other threads search for loops and refine the map, while the caller maps on."""
    with ThreadPoolExecutor(_BACKGROUND_THREADS, thread_name_prefix="slam") as executor:

        def begin(task: Callable[[], _T], /) -> Callable[[], _T]:
            return executor.submit(task).result

        yield begin


@dataclass(frozen=True, slots=True)
class Setup:
    """What must be known before the first scan: where the laser sits, and how it really sweeps."""

    mount: Mount
    mount_source: str
    sweep: SweepVerdict


def look_ahead(messages: Iterable[Message], config: Config) -> Setup:
    """Read the beginning of a recording for the laser's pose, from /tf_static or else the config, and its sweep."""
    transforms: list[Transform] = []
    scans: list[LaserScan] = []
    base_frame, laser_frame, chunks = config.replay.base_frame, LASER_FRAME, 0
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
        chunks += isinstance(message, RawChunk)
        if len(scans) >= TRIAL_SCANS or chunks >= _LOOK_AHEAD_CHUNKS:
            break
    mount, source = resolve_mount(transforms, config, base_frame, laser_frame)
    if chunks:
        sweep = SweepVerdict(is_reversed=False, reason="known, from raw bytes")
    elif config.replay.sweep == "auto":
        sweep = detect_sweep(scans, config.mapping_settings(), mount)
    else:
        sweep = SweepVerdict(is_reversed=config.replay.sweep == "reversed", reason="set in the configuration")
    return Setup(mount, source, sweep)


def resolve_mount(
    transforms: list[Transform], config: Config, base_frame: str | None, laser_frame: str
) -> tuple[Mount, str]:
    """Return the laser's mount and where it was found."""
    for base in dict.fromkeys((base_frame, *BASE_FRAMES)) if base_frame else BASE_FRAMES:
        mount = find_mount(transforms, base, laser_frame)
        if mount is not None:
            return mount, f"/tf_static {base} -> {laser_frame}"
    return config.mount(), "config lidar.mount"


def warm_up() -> None:
    """Load all compiled code by mapping a few turns in a made-up room, so that no scan waits for the compiler.

    That takes part of a second, on the first run ever, which compiles, about a minute.
    """
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
