"""The one data flow, for live runs and replays alike: messages in, trajectory and map out.

This is the only place that picks the concrete parts. Nothing in it depends on when it is called, so the same messages
give the same map; only the stopwatch for the report looks at a clock.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drivers.messages import LaserScan, LidarStream, Message, Odometry, RawChunk, Transform
from drivers.rplidar_decoder import DecoderCounters, RplidarDecoder
from mapping.frames import find_mount
from mapping.grid import GridBuilder
from mapping.sensor_models import LidarModel
from mapping.slam import MappedScan, Mapper, Mount
from mapping.sweep import TRIAL_SCANS, SweepVerdict, detect_sweep, reverse_sweep
from tools.config import Config

LASER_FRAME = "laser"  # of our own driver
BASE_FRAMES = ("base_link", "base_footprint")
_LOOK_AHEAD_CHUNKS = 200


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

    def __init__(self, config: Config, mount: Mount, *, sweep_reversed: bool = False) -> None:
        self.mapper = Mapper(config.mapping_settings(), mount)
        self.scans = 0
        self.seconds: list[float] = []
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
        """Map what still waits; call once after the last message."""
        return self.mapper.finish()


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
    """Load the compiled ray traversal (seconds on the first run ever), so that no scan waits for it."""
    builder = GridBuilder(1.0, LidarModel())
    builder.add_scan(np.zeros(2), np.ones((1, 2)))
