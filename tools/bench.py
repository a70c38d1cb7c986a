"""Speed and memory of decoding and mapping on a recording, beside the bound that the sensor sets: its own pace."""

from __future__ import annotations

import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.errors import RecordingError
from drivers.messages import LaserScan
from drivers.recording_reader import Recording
from tools.config import Config
from tools.pipeline import LidarDecoding, MappingFlow, look_ahead, warm_up


@dataclass(frozen=True, slots=True)
class StageTiming:
    """Milliseconds that one stage took for one turn of the lidar."""

    stage: str
    median_ms: float
    p95_ms: float
    max_ms: float

    @staticmethod
    def of(stage: str, seconds: Sequence[float]) -> StageTiming:
        """Return the statistics of the seconds per turn."""
        values = np.asarray(seconds) * 1e3
        return StageTiming(stage, float(np.median(values)), float(np.percentile(values, 95)), float(values.max()))


@dataclass(frozen=True, slots=True)
class BenchReport:
    """What a recording cost: turn_ms is the bound, the median time between two of its scans."""

    scans: int
    turn_ms: float
    stages: tuple[StageTiming, ...]
    real_time_factor: float
    peak_memory_mb: float


def bench_recording(recording: Recording, config: Config) -> BenchReport:
    """Decode and map the recording, one turn at a time; raises RecordingError where there is no scan in it."""
    warm_up()
    setup = look_ahead(recording.messages(config.replay.scan_topic), config)
    decoding = LidarDecoding()
    flow = MappingFlow(config, setup.mount, sweep_reversed=setup.sweep.is_reversed)
    decode_s: list[float] = []
    stamps: list[int] = []
    pending_s = 0.0
    for message in recording.messages(config.replay.scan_topic):
        started = time.perf_counter()
        decoded = decoding.feed(message)
        pending_s += time.perf_counter() - started
        for one in decoded:
            if isinstance(one, LaserScan):
                decode_s.append(pending_s)
                pending_s = 0.0
                stamps.append(one.stamp_ns)
            flow.feed(one)
    flow.finish()
    if not flow.seconds or len(stamps) < 2:
        raise RecordingError(
            f"{recording.path}: fewer than two scans in it, or none that can be mapped: nothing to measure"
        )
    span_s = float(np.ptp(stamps)) * 1e-9
    return BenchReport(
        scans=len(stamps),
        turn_ms=float(np.median(np.diff(stamps))) * 1e-6,
        stages=(StageTiming.of("decode", decode_s), StageTiming.of("map", flow.seconds)),
        real_time_factor=span_s / (sum(decode_s) + sum(flow.seconds)),
        peak_memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    )
