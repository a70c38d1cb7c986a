"""What SLAM costs on a recording: time by stage, the thesis's real-time factor, and memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mapping.front_end
import mapping.graph_slam
from drivers.errors import RecordingError
from drivers.messages import LaserScan, Message
from drivers.recording_reader import Recording, open_recording
from mapping.errors import RelationsError
from mapping.graph_slam import GraphSlam
from mapping.odometry import LidarOdometry
from mapping.relations import read_relations, relation_errors
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.pipeline import LidarDecoding, MappingFlow, look_ahead, warm_up
from tools.processes import Memory, memory, reset_peak
from tools.replay_run import recorded_config
from tools.stopwatch import StageTime, Stopwatch

FloatArray = NDArray[np.float64]

DECODE, REST, MATCH, LINES = "read and decode", "front end: rest", "front end: kiss-icp", "front end: keyframe lines"
GRAPH, SEARCH, FINISH, REFINE, GRID = "graph", "loop search", "finish", "joint refinement", "grid"
TO_GRAPH = (DECODE, REST, MATCH, LINES, GRAPH, SEARCH, FINISH)  # tau up to the pose graph
STAGES = (*TO_GRAPH, REFINE, GRID)
_PARTS = (
    (LidarOdometry, "match", MATCH),
    (LidarOdometry, "learn", MATCH),
    (mapping.front_end, "match_groups", LINES),
    (GraphSlam, "add", GRAPH),
    (mapping.graph_slam, "close_loops", SEARCH),
    (mapping.graph_slam, "refine_jointly", REFINE),  # on the way and at the end
)


@dataclass(frozen=True, slots=True)
class Spread:
    """Of a quantity in ms."""

    mean: float
    median: float
    p99: float
    p999: float
    max: float

    @staticmethod
    def of(seconds: list[float]) -> Spread:
        """Return mean and percentiles of at least one value in s, as ms."""
        values = np.asarray(seconds) * 1e3
        median, p99, p999 = np.percentile(values, [50, 99, 99.9]).tolist()
        return Spread(float(values.mean()), median, p99, p999, float(values.max()))


@dataclass(frozen=True, slots=True)
class Stage:
    """What a stage took in all."""

    name: str
    cpu_s: float
    wall_s: float
    cpu_ms_per_scan: float


@dataclass(frozen=True, slots=True)
class RealTimeFactor:
    """Time to map over duration of the data (thesis fig. 4.1), by CPU and by wall time; over 1: lags behind."""

    cpu: float
    wall: float


@dataclass(frozen=True, slots=True)
class RelationScore:
    """Mean absolute errors by true relative poses (Kuemmerle et al. 2009)."""

    relations: int
    mean_m: float
    mean_deg: float


@dataclass(frozen=True, slots=True)
class SlamCost:
    """What mapping one recording cost, in a process of its own.

    samples: median a scan, without a return too. tau_graph: up to the pose graph; tau: with refinement and grid.
    memory_start: before the first scan; memory_graph: after the last one, with the peak so far; refine_peak_mb: the
    most during the joint refinement alone, nan where the system cannot tell.
    """

    log: str
    simulated: bool
    scans: int
    samples: int
    scan_period_ms: float
    duration_s: float
    length_m: float
    keyframes: int
    closures: int
    resolution_m: float
    stages: tuple[Stage, ...]
    scan_cpu_ms: Spread
    tau_graph: RealTimeFactor
    tau: RealTimeFactor
    memory_start: Memory
    memory_graph: Memory
    refine_peak_mb: float
    score: RelationScore | None


def is_simulated(recording: Recording) -> bool:
    """Whether the recording says of itself that no real sensor was involved."""
    return recording.metadata.get("mapfuse.origin", {}).get("simulated") == "true"


def bench_slam(path: Path, config: Config | None, relations: tuple[Path, ...] = ()) -> SlamCost:
    """Map a recording and return what it cost; config None: the recorded one. For a process of its own.

    relations: files of true relative poses; the one whose stamps are in the recording scores it. Raises RecordingError
    where fewer than two scans can be mapped.
    """
    warm_up()
    watch, counted = Stopwatch(), _ScanCount()
    with open_recording(path) as recording:
        settings = config or recorded_config(recording)
        setup = look_ahead(recording.messages(settings.replay.scan_topic), settings)
        flow = MappingFlow(settings, setup.mount, sweep_reversed=setup.sweep.is_reversed)
        reset_peak()
        at_start = memory()
        with watch.timing(_PARTS):
            scan_cpu_s = _map_all(_decoded(recording, settings, watch), flow, watch, counted)
        simulated = is_simulated(recording)
    if len(flow.mapper.trajectory) < 2:
        raise RecordingError(f"{path}: fewer than two scans that can be mapped: nothing to measure")
    at_graph = memory()
    was_reset = reset_peak()
    with watch.stage(REFINE):
        flow.refine()
    refine_peak_mb = memory().peak_mb if was_reset else float("nan")
    with watch.stage(GRID):
        flow.mapper.grid()
    trajectory, graph = flow.mapper.trajectory, flow.mapper.graph
    return SlamCost(
        log=path.name, simulated=simulated, scans=len(counted.stamps), samples=int(np.median(counted.samples)),
        scan_period_ms=float(np.median(np.diff(counted.stamps))) * 1e-6, duration_s=counted.duration_s,
        length_m=trajectory.length_m, keyframes=len(graph.keyframe_poses), closures=len(graph.closures),
        resolution_m=settings.grid.resolution_m, stages=_stages(watch, len(counted.stamps)),
        scan_cpu_ms=Spread.of(scan_cpu_s), tau_graph=_tau(watch, TO_GRAPH, counted.duration_s),
        tau=_tau(watch, STAGES, counted.duration_s), memory_start=at_start, memory_graph=at_graph,
        refine_peak_mb=refine_peak_mb, score=score_by_relations(trajectory, relations),
    )  # fmt: skip


class _ScanCount:
    """Stamps in ns and numbers of samples of the scans."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.samples: list[int] = []

    def add(self, scan: LaserScan) -> None:
        self.stamps.append(scan.stamp_ns)
        self.samples.append(len(scan.ranges_m))

    @property
    def duration_s(self) -> float:
        """Time from the first to the last scan."""
        return float(np.ptp(self.stamps)) * 1e-9


def _decoded(recording: Recording, config: Config, watch: Stopwatch) -> Iterator[Message]:
    """Yield decoded messages; reading and decoding are timed."""
    decoding, messages = LidarDecoding(), recording.messages(config.replay.scan_topic)
    while True:
        with watch.stage(DECODE):
            message = next(messages, None)
            decoded = [] if message is None else decoding.feed(message)
        if message is None:
            return
        yield from decoded


def _map_all(messages: Iterator[Message], flow: MappingFlow, watch: Stopwatch, counted: _ScanCount) -> list[float]:
    """Feed everything and finish; return the CPU seconds that each scan took, searches at once included."""
    scan_cpu_s: list[float] = []
    pending_s = 0.0
    for message in messages:
        began = time.process_time()
        with watch.stage(REST):
            mapped = flow.feed(message)
        pending_s += time.process_time() - began
        if mapped:
            scan_cpu_s += [pending_s / len(mapped)] * len(mapped)
            pending_s = 0.0
        if isinstance(message, LaserScan):
            counted.add(message)
    with watch.stage(FINISH):
        flow.finish()
    return scan_cpu_s or [0.0]


def _stages(watch: Stopwatch, scans: int) -> tuple[Stage, ...]:
    times = {name: watch.stages.get(name, StageTime()) for name in STAGES}
    return tuple(Stage(name, of.cpu_s, of.wall_s, of.cpu_s * 1e3 / scans) for name, of in times.items())


def _tau(watch: Stopwatch, names: tuple[str, ...], duration_s: float) -> RealTimeFactor:
    times = [watch.stages[name] for name in names if name in watch.stages]
    return RealTimeFactor(
        sum(each.cpu_s for each in times) / duration_s, sum(each.wall_s for each in times) / duration_s
    )


def score_by_relations(trajectory: Trajectory, relations: tuple[Path, ...]) -> RelationScore | None:
    """Return the errors by the first file whose stamps are in the trajectory; raise RelationsError for a bad file."""
    for path in relations:
        true = read_relations(path)
        try:
            errors = relation_errors(trajectory, true)
        except RelationsError:
            continue  # of another log
        return RelationScore(errors.relations, errors.mean_m, errors.mean_deg)
    return None
