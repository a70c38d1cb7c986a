"""The thesis's table 4.1 on a log: maps for grid resolutions r and scan rates T, and their cost (figures 4.1, 4.2).

Mapping does not depend on r, so each rate is mapped once and drawn at every resolution; the time to map that is stated
for a pair is mapping plus drawing at that r.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.messages import LaserScan
from drivers.recording_reader import Recording
from mapping import se2
from mapping.graph_slam import PoseGraph
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.relations import Relations, relation_errors
from mapping.sensor_models import LidarModel
from mapping.slam import Mapper
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.pipeline import LidarDecoding, MappingFlow, Setup, look_ahead, warm_up

FloatArray = NDArray[np.float64]

_AGREEMENT_RESOLUTION_M = 0.05
LEAST_AGREEMENT = 0.88  # good maps of real logs have 90 to 95 %, bent ones less than 87 %: see docs/slam.md
MOST_UNMATCHED = 0.1
MOST_ERROR_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class RateMap:
    """One map of the table: r in cells/m, every `scan_every`-th scan, T in Hz; map_size is rows x cols.

    tau: time to map over duration of the data by CPU time, tau_wall by wall-clock time; with refinement and drawing.
    agreement: share of the scans' points that lie on walls of the map, whatever its resolution. failures: reasons why
    the map is not to be believed; none for a good one. error_m, error_deg: by true relative poses, None without.
    """

    cells_per_meter: float
    scan_every: int
    rate_hz: float
    scans: int
    map_size: tuple[int, int]
    tau: float
    tau_wall: float
    agreement: float
    error_m: float | None
    error_deg: float | None
    failures: tuple[str, ...]
    grid: OccupancyGrid
    graph: PoseGraph


@dataclass(frozen=True, slots=True, eq=False)
class _Mapping:
    """One rate, mapped and refined."""

    mapper: Mapper
    cpu_s: float
    wall_s: float
    duration_s: float
    rate_hz: float


def study_rates(
    recording: Recording,
    config: Config,
    resolutions: Sequence[float],
    every: Sequence[int],
    relations: Relations | None,
    on_progress: Callable[[str], None],
) -> list[RateMap]:
    """Return the maps of a recording for resolutions in cells/m and rates, every k-th scan; rates outside.

    Raises RecordingError where there is no scan in it.
    """
    warm_up()
    setup = look_ahead(recording.messages(config.replay.scan_topic), config)
    maps = []
    for scan_every in every:
        mapped = _map(recording, config.with_slam(loop_closure=None, refine=None, scan_every=scan_every), setup)
        score = None if relations is None else _score(mapped.mapper.trajectory, relations)
        agreement = wall_agreement(mapped.mapper, config.mapping_settings().lidar_model)
        failures = _failures(mapped.mapper, agreement, None if score is None else score[0])
        for cells_per_meter in resolutions:
            rate_map = _drawn(mapped, config, cells_per_meter, scan_every, (agreement, score, failures))
            maps.append(rate_map)
        on_progress(
            f"every {scan_every}. scan, {mapped.rate_hz:.2f} Hz: {mapped.mapper.counters.mapped} scans,"
            f" tau {maps[-1].tau:.4f}{''.join(f', FAILED: {reason}' for reason in failures)}"
        )
    return maps


def _map(recording: Recording, config: Config, setup: Setup) -> _Mapping:
    """Map with one rate; reading and decoding are part of the time."""
    cpu_began, began = time.process_time(), time.perf_counter()
    flow = MappingFlow(config, setup.mount, sweep_reversed=setup.sweep.is_reversed)
    decoding = LidarDecoding()
    stamps: list[int] = []
    for message in recording.messages(config.replay.scan_topic):
        for decoded in decoding.feed(message):
            if isinstance(decoded, LaserScan):
                stamps.append(decoded.stamp_ns)
            flow.feed(decoded)
    flow.finish()
    flow.refine()
    cpu_s, wall_s = time.process_time() - cpu_began, time.perf_counter() - began
    duration_s = float(np.ptp(stamps)) * 1e-9 if stamps else 0.0
    if len(stamps) < 2 or duration_s <= 0.0:
        raise RecordingError(f"{recording.path}: fewer than two scans in it: nothing to map")
    return _Mapping(
        flow.mapper, cpu_s, wall_s, duration_s, (len(stamps) - 1) / duration_s / config.slam.scan_every
    )  # fmt: skip


def _drawn(
    mapped: _Mapping,
    config: Config,
    cells_per_meter: float,
    scan_every: int,
    verdict: tuple[float, tuple[float, float] | None, tuple[str, ...]],
) -> RateMap:
    """Return the map at one resolution."""
    cpu_began, began = time.process_time(), time.perf_counter()
    grid = _grid(mapped.mapper, 1.0 / cells_per_meter, config.mapping_settings().lidar_model)
    cpu_s = mapped.cpu_s + time.process_time() - cpu_began
    wall_s = mapped.wall_s + time.perf_counter() - began
    agreement, score, failures = verdict
    rows, cols = grid.log_odds.shape
    return RateMap(
        cells_per_meter, scan_every, mapped.rate_hz, mapped.mapper.counters.mapped, (rows, cols),
        cpu_s / mapped.duration_s, wall_s / mapped.duration_s, agreement,
        None if score is None else score[0], None if score is None else score[1],
        failures, grid, mapped.mapper.graph.pose_graph(),
    )  # fmt: skip


def _grid(mapper: Mapper, resolution_m: float, model: LidarModel) -> OccupancyGrid:
    builder = GridBuilder(resolution_m, model)
    for pose, points in mapper.graph.placed_scans():
        builder.add_scan(se2.transform_points(pose, mapper.mount.pose[:2]), se2.transform_points(pose, points))
    return builder.grid()


def wall_agreement(mapper: Mapper, model: LidarModel) -> float:
    """Return the share of all scans' points that lie on a wall of the map or beside one; nan without any.

    Where a wall is drawn twice, rays to the one copy clear the other, and points of that lie in free space.
    """
    grid = _grid(mapper, _AGREEMENT_RESOLUTION_M, model)
    wall = np.pad(grid.occupied, 1)
    rows, cols = grid.log_odds.shape
    near = np.zeros((rows, cols), np.bool_)
    for row in range(3):
        for col in range(3):
            near |= wall[row : row + rows, col : col + cols]
    hits = count = 0
    for pose, points in mapper.graph.placed_scans():
        sensor = mapper.mount.pose[:2]
        seen = points[np.hypot(*(points - sensor).T) <= model.max_range_m]
        cells = np.floor(grid.cell_coordinates(se2.transform_points(pose, seen))).astype(np.int64)
        inside = ((cells >= 0) & (cells < [cols, rows])).all(axis=1)
        hits += int(np.count_nonzero(near[cells[inside, 1], cells[inside, 0]]))
        count += len(seen)
    return hits / count if count else float("nan")


def _score(trajectory: Trajectory, relations: Relations) -> tuple[float, float] | None:
    """Return mean errors in m and deg, with poses between two mapped scans interpolated; None before two poses.

    Relations outside the mapped time are left out.
    """
    if len(trajectory) < 2:
        return None
    first, last = trajectory.stamps_ns[[0, -1]]
    inside = (np.minimum(relations.first_ns, relations.second_ns) >= first) & (
        np.maximum(relations.first_ns, relations.second_ns) <= last
    )
    kept = Relations(relations.first_ns[inside], relations.second_ns[inside], relations.poses[inside])
    wanted = np.unique(np.concatenate([kept.first_ns, kept.second_ns]))
    if not len(wanted):
        return None
    errors = relation_errors(Trajectory(wanted, trajectory.at(wanted)), kept)
    return errors.mean_m, errors.mean_deg


def _failures(mapper: Mapper, agreement: float, error_m: float | None) -> tuple[str, ...]:
    """Return why a map is not to be believed: where the truth is known, by its error, else by signs in it."""
    counters, segments = mapper.counters, mapper.graph.segments()
    outside = sum(not segment.in_map for segment in segments)
    tracked = counters.mapped + counters.unmatched
    unmatched = counters.unmatched / tracked if tracked else 1.0
    always = (
        (not counters.mapped, "no scan was mapped"),
        (outside > 0, f"{outside} of {len(segments)} pieces not in the map"),
    )
    signs = (
        (counters.lost > 0, f"tracking lost {counters.lost} time{'s' if counters.lost > 1 else ''}"),
        (tracked > 0 and unmatched > MOST_UNMATCHED, f"{unmatched:.0%} of the scans not matched"),
        (agreement < LEAST_AGREEMENT, f"only {agreement:.0%} of the points on walls"),
    )
    truth = ((error_m is not None and error_m > MOST_ERROR_M, f"error {error_m or 0.0:.2f} m"),)
    checks = always + (signs if error_m is None else truth)
    return tuple(reason for failed, reason in checks if failed)
