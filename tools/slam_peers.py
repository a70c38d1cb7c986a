"""kiss-icp alone on the same scans, as a peer of the whole: its stock pipeline, and as this project configures it.

Source: Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP" (RA-L 2023), the package's own class KissICP.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from kiss_icp.config.parser import load_config
from kiss_icp.kiss_icp import KissICP
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from drivers.recording_reader import open_recording
from mapping import se2
from mapping.deskew import reference_offset_s
from mapping.mount import Mount
from mapping.odometry import LidarOdometry
from mapping.sweep import reverse_sweep
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.pipeline import LidarDecoding, look_ahead
from tools.processes import memory, reset_peak
from tools.replay_run import recorded_config
from tools.slam_bench import RelationScore, score_by_relations

FloatArray = NDArray[np.float64]

_LEAST_POINTS = 30


@dataclass(frozen=True, slots=True)
class PeerCost:
    """What a peer took for the same scans; figures are None where it did not run, and `note` says why."""

    name: str
    note: str
    cpu_ms_per_scan: float | None = None
    tau_cpu: float | None = None
    tau_wall: float | None = None
    peak_mb: float | None = None
    score: RelationScore | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Input:
    """Messages for a peer, decoded, and the laser's place."""

    messages: list[LaserScan | Odometry]
    mount: Mount
    config: Config

    @property
    def scans(self) -> list[LaserScan]:
        """The scans alone."""
        return [message for message in self.messages if isinstance(message, LaserScan)]


def _read(path: Path, config: Config | None) -> _Input:
    """Read everything before the time is taken."""
    with open_recording(path) as recording:
        settings = config or recorded_config(recording)
        setup = look_ahead(recording.messages(settings.replay.scan_topic), settings)
        decoding = LidarDecoding()
        kept: list[LaserScan | Odometry] = []
        for message in recording.messages(settings.replay.scan_topic):
            for decoded in decoding.feed(message):
                if isinstance(decoded, LaserScan):
                    kept.append(reverse_sweep(decoded) if setup.sweep.is_reversed else decoded)
                elif isinstance(decoded, Odometry):
                    kept.append(decoded)
    return _Input(kept, setup.mount, settings)


def bench_stock_kiss_icp(path: Path, config: Config | None, relations: tuple[Path, ...]) -> PeerCost:
    """Run kiss-icp's own pipeline with its own settings on the scans as clouds with z = 0. For a process of its own."""
    return _run("kiss-icp alone, stock", "no wheels, no loops", path, config, relations, _stock)


def bench_own_kiss_icp(path: Path, config: Config | None, relations: tuple[Path, ...]) -> PeerCost:
    """Run this project's scan matching and nothing else: no keyframes, doubts, loops. For a process of its own."""
    return _run("kiss-icp alone, as configured here", "wheels as guess, no loops", path, config, relations, _configured)


def _run(
    name: str,
    note: str,
    path: Path,
    config: Config | None,
    relations: tuple[Path, ...],
    register: Callable[[_Input], Iterator[tuple[int, FloatArray]]],
) -> PeerCost:
    given = _read(path, config)
    reset_peak()
    cpu_began, began = time.process_time(), time.perf_counter()
    poses = dict(register(given))
    cpu_s, wall_s = time.process_time() - cpu_began, time.perf_counter() - began
    scans = given.scans
    duration_s = float(np.ptp([scan.stamp_ns for scan in scans])) * 1e-9
    trajectory = Trajectory(
        np.array(sorted(poses), dtype=np.int64), np.array([poses[stamp] for stamp in sorted(poses)])
    )
    return PeerCost(
        name, note, cpu_s * 1e3 / len(scans), cpu_s / duration_s, wall_s / duration_s, memory().peak_mb,
        score_by_relations(trajectory, relations),
    )  # fmt: skip


def _points(scan: LaserScan, mount: Mount) -> tuple[FloatArray, FloatArray]:
    """Return the scan's measurements (N, 2) in the body frame and their times (N,) after its stamp."""
    valid = scan.valid
    return mount.to_body(scan.angles_rad[valid], scan.ranges_m[valid]), scan.offsets_s[valid]


def _reference_ns(scan: LaserScan) -> int:
    """Return the instant that a scan's pose is of."""
    return scan.stamp_ns + round(reference_offset_s(scan.offsets_s) * 1e9)


def _stock(given: _Input) -> Iterator[tuple[int, FloatArray]]:
    """Yield stamp and pose (3,) of each scan; where the source tells no times within a scan, nothing is de-skewed."""
    settings = load_config(None)
    settings.data.deskew = any(scan.offsets_s.any() for scan in given.scans[:10])
    pipeline = KissICP(settings)
    for scan in given.scans:
        points, offsets = _points(scan, given.mount)
        if len(points) < _LEAST_POINTS:
            continue
        span_s = float(scan.offsets_s.max(initial=0.0))
        pipeline.register_frame(
            np.column_stack([points, np.zeros(len(points))]), offsets / span_s if span_s else offsets
        )
        yield _reference_ns(scan), se2.from_matrix4(pipeline.last_pose)


def _configured(given: _Input) -> Iterator[tuple[int, FloatArray]]:
    """Yield stamp and pose (3,) of each scan, guessed by the wheels, else by the motion before."""
    odometry = LidarOdometry(given.config.mapping_settings().odometry)
    wheels = _wheels_at_scans(given)
    last, motion = se2.IDENTITY, se2.IDENTITY
    for number, scan in enumerate(given.scans):
        points, _ = _points(scan, given.mount)
        if number and np.isfinite(wheels[number - 1 : number + 1]).all():
            motion = se2.between(wheels[number - 1], wheels[number])
        match = odometry.match(points, se2.compose(last, motion))
        if match.accepted:
            odometry.learn(points, match.pose)
        motion = se2.between(last, match.pose)
        last = match.pose
        yield _reference_ns(scan), last


def _wheels_at_scans(given: _Input) -> FloatArray:
    """Return the wheels' pose (N, 3) at each scan's instant; nan where none was recorded around it."""
    stamps = np.array([_reference_ns(scan) for scan in given.scans], dtype=np.int64)
    known = {message.stamp_ns: message.pose for message in given.messages if isinstance(message, Odometry)}
    poses = np.full((len(stamps), 3), np.nan)
    if known:
        rising = np.array(sorted(known), dtype=np.int64)
        covered = (stamps >= rising[0]) & (stamps <= rising[-1])
        drive = Trajectory(rising, np.array([known[stamp] for stamp in rising.tolist()]))
        poses[covered] = drive.at(stamps[covered])
    return poses
