"""SLAM at the lidar's own pace: how long a pose takes to come out, with loops searched for in another thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from drivers.errors import RecordingError
from drivers.messages import LaserScan, LidarStream, Message, Recordable, Transform
from drivers.recording_reader import open_recording
from mapping.deskew import reference_offset_s
from mapping.slam import MappedScan
from mapping.sweep import reverse_sweep
from tools.config import Config
from tools.live_run import run_live
from tools.pipeline import MappingFlow, look_ahead, search_thread, warm_up
from tools.processes import memory, reset_peak
from tools.replay_run import recorded_config
from tools.slam_bench import Spread, is_simulated


@dataclass(frozen=True, slots=True)
class LiveCost:
    """A live-like run: the recording's messages at their real pace, loops searched for in another thread.

    latency_ms: from a scan's last byte to its pose, the wait for wheel odometry included; mapping_ms: wall time of
    mapping a scan. cpu_ms_per_scan: of the whole process, reading and searches included.
    """

    log: str
    simulated: bool
    scans: int
    mapped: int
    dropped: int
    seconds: float
    cpu_ms_per_scan: float
    latency_ms: Spread
    mapping_ms: Spread
    peak_mb: float


class PacedSource:
    """A recording as a live source: each message comes when it came then, up to so many seconds of the recording.

    open_messages is called, and its generator closed, in the thread that iterates: SQLite insists on that.
    """

    def __init__(self, open_messages: Callable[[], Generator[Message, None, None]], most_s: float) -> None:
        self._open_messages = open_messages
        self._most_s = most_s
        self._stop = threading.Event()

    def __iter__(self) -> Iterator[Message]:
        first_ns: int | None = None
        began = time.monotonic()
        with closing(self._open_messages()) as messages:
            for message in messages:
                arrival_ns = _arrival_ns(message)
                if arrival_ns is not None:
                    first_ns = arrival_ns if first_ns is None else first_ns
                    due_s = (arrival_ns - first_ns) * 1e-9
                    wait_s = began + due_s - time.monotonic()
                    if due_s > self._most_s or self._stop.wait(max(wait_s, 0.0)):
                        return
                yield message

    def request_stop(self) -> None:
        """End the iteration."""
        self._stop.set()


def _messages_of(path: Path, scan_topic: str | None) -> Generator[Message, None, None]:
    """Yield the messages of a recording that is open meanwhile."""
    with open_recording(path) as recording:
        yield from recording.messages(scan_topic)


def _arrival_ns(message: Message) -> int | None:
    """Return when a message can have come at the earliest: a scan after its last sample.

    None for what says how the robot is built, whose stamp may be from long before.
    """
    if isinstance(message, (Transform, LidarStream)):
        return None
    if isinstance(message, LaserScan):
        return message.stamp_ns + round(float(message.offsets_s.max(initial=0.0)) * 1e9)
    return message.stamp_ns


class ScanLatency:
    """Notes when a scan came in, and how long after that its pose was there."""

    def __init__(self, *, sweep_reversed: bool) -> None:
        self.seconds: list[float] = []
        self._sweep_reversed = sweep_reversed
        self._arrived: dict[int, float] = {}

    def put(self, message: Recordable) -> None:
        """Take what the sensor's thread hands to the recorder."""
        if isinstance(message, LaserScan):
            scan = reverse_sweep(message) if self._sweep_reversed else message
            reference_ns = scan.stamp_ns + round(reference_offset_s(scan.offsets_s) * 1e9)
            self._arrived[reference_ns] = time.perf_counter()

    def on_mapped(self, mapped: MappedScan) -> None:
        """Take a pose."""
        arrived = self._arrived.pop(mapped.stamp_ns, None)
        if arrived is not None:
            self.seconds.append(time.perf_counter() - arrived)


def bench_live(path: Path, config: Config | None, most_s: float) -> LiveCost:
    """Feed up to most_s seconds of a recording at their real pace through a live run. For a process of its own."""
    warm_up()
    with open_recording(path) as recording, search_thread() as background:
        settings = config or recorded_config(recording)
        setup = look_ahead(recording.messages(settings.replay.scan_topic), settings)
        flow = MappingFlow(
            settings, setup.mount, sweep_reversed=setup.sweep.is_reversed, background=background, live=True
        )
        latency = ScanLatency(sweep_reversed=setup.sweep.is_reversed)
        source = PacedSource(partial(_messages_of, path, settings.replay.scan_topic), most_s)
        reset_peak()
        began, cpu_began = time.monotonic(), time.process_time()
        outcome = run_live(source, flow, threading.Event(), put=latency.put, on_mapped=latency.on_mapped)
        cpu_s, seconds = time.process_time() - cpu_began, time.monotonic() - began
        simulated = is_simulated(recording)
    if outcome.fault is not None:
        raise outcome.fault
    if not latency.seconds:
        raise RecordingError(f"{path}: none of its scans can be mapped: nothing to measure")
    return LiveCost(
        log=path.name, simulated=simulated, scans=flow.scans, mapped=flow.mapper.counters.mapped,
        dropped=outcome.dropped_scans, seconds=seconds, cpu_ms_per_scan=cpu_s * 1e3 / flow.scans,
        latency_ms=Spread.of(latency.seconds), mapping_ms=Spread.of(flow.seconds), peak_mb=memory().peak_mb,
    )  # fmt: skip
