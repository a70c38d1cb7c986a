"""A session with a lidar: open and start it, record it, map it, save what came of it."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drivers.errors import DriverError
from drivers.messages import LidarStream, Recordable, Transform
from drivers.recording_writer import McapRecorder, RecordingReport
from drivers.rplidar import Rplidar, open_rplidar
from drivers.rplidar_models import is_emulated
from mapping.frames import planar_transform
from mapping.graph_state import GraphState
from mapping.slam import MappedScan
from tools.clock import RunClock
from tools.config import Config, ConfigError
from tools.live_run import LiveOutcome, record_live, run_live
from tools.localisation import Localisation
from tools.pipeline import LASER_FRAME, MappingFlow, resolve_mount, search_thread, warm_up
from tools.replay_run import CONFIG_RECORD
from tools.results import Report, decoding_summary, grid_snapshot, lost_pieces, save_results
from tools.signals import Stop

log = logging.getLogger(__name__)

RECORDING_NAME = "recording.mcap"
_PROGRESS_S = 2.0


def run_session(
    port: str,
    config: Config,
    new_folder: Callable[[], Path],
    stop: Stop,
    *,
    record: bool,
    resume: GraphState | None = None,
    map_file: Path | None = None,
) -> tuple[Report, DriverError | None]:
    """Map live until `stop`; return the report and the fault that ended the run early, once all is saved.

    Map, trajectory and state are saved, then refined and saved again; another signal meanwhile leaves that out. Raises
    DriverError when the lidar cannot be started, ConfigError for settings of replays: nothing is written then.
    """
    if config.odometry.source == "wheel":
        raise ConfigError(
            "odometry.source: wheel is for replays of recordings with odometry: a lidar alone has no wheels"
        )
    clock = RunClock()
    warm_up()
    with search_thread() as background, _started_lidar(port, config, clock) as (lidar, stream):
        folder = new_folder()
        laser_pose = _laser_pose(config, stream.stamp_ns)
        mount, _ = resolve_mount([laser_pose], config, None, LASER_FRAME)
        live = record and config.grid.live_s > 0
        flow = MappingFlow(config, mount, background=background, resume=resume, live=live)
        localisation = None if map_file is None else Localisation(map_file, mount.pose[:2])
        recorder = _start_recording(folder / RECORDING_NAME, config, clock, stream, laser_pose) if record else None
        put: Callable[[Recordable], None] = _discard if recorder is None else recorder.put
        try:
            on_mapped = _OnMapped(flow, localisation, put, config.grid.live_s)
            outcome = run_live(lidar, flow, stop, put=put, on_mapped=on_mapped, release=lidar.close)
            if len(flow.mapper.trajectory):
                put(grid_snapshot(flow.mapper.grid(), int(flow.mapper.trajectory.stamps_ns[-1])))
        finally:
            recorded = None if recorder is None else recorder.close()
    details = _session_details(stream, outcome, recorded)
    if localisation is not None:
        details["localisation"] = localisation.save(folder)
    report = save_results(folder, flow, port, details, save_state=True)
    asked = stop.asked
    if config.slam.refine and report["trajectory"]["poses"]:
        log.info("saved; refining the map (Ctrl-C again to leave that out)")
        if flow.refine(lambda: stop.asked > asked):
            report = save_results(folder, flow, port, details, save_state=True)
    for line in lost_pieces(report):
        log.warning("%s", line)
    _log_end(report, folder)
    return report, outcome.fault


def record_session(port: str, config: Config, path: Path, stop: threading.Event) -> tuple[Report, DriverError | None]:
    """Record until `stop`; return the report and the fault that ended the recording early."""
    clock = RunClock()
    with _started_lidar(port, config, clock) as (lidar, stream):
        recorder = _start_recording(path, config, clock, stream, _laser_pose(config, stream.stamp_ns))
        try:
            outcome = record_live(lidar, stop, put=recorder.put)
        finally:
            recorded = recorder.close()
    report = _session_details(stream, outcome, recorded)
    log.info("%s: %d bytes, %s scans", path, recorded.bytes, recorded.written.get("/scan", 0))
    return report, outcome.fault


@contextmanager
def _started_lidar(port: str, config: Config, clock: RunClock) -> Iterator[tuple[Rplidar, LidarStream]]:
    """Open, check and start the lidar; stop and close it at the end. Raises DriverError."""
    section = config.lidar
    with open_rplidar(port, baud=section.baud, clock=clock) as lidar:
        stream = lidar.start(section.mode, section.motor_pwm)
        log.info(
            "RPLIDAR %s at %s, %d baud%s: firmware %s, serial %s; mode %s, %.0f samples a second",
            stream.model,
            port,
            stream.baud,
            " (EMULATED: simulated data)" if is_emulated(stream.serial) else "",
            stream.firmware,
            stream.serial,
            stream.mode,
            1e6 / stream.sample_us,
        )
        yield lidar, stream


def _laser_pose(config: Config, stamp_ns: int) -> Transform:
    """Return the configured pose of the laser as the static transform that live run and replay both start from.

    Its stamp must not be later than the stream's first bytes, which replay reads in the order of time.
    """
    mount = config.lidar.mount
    pose = np.array([mount.x_m, mount.y_m, mount.z_m, mount.yaw_rad])
    return planar_transform(stamp_ns, "base_link", LASER_FRAME, pose, inverted=mount.inverted)


def _start_recording(
    path: Path, config: Config, clock: RunClock, stream: LidarStream, laser_pose: Transform
) -> McapRecorder:
    """Create the recording and enter what replay needs before the first byte: configuration, clock, laser pose."""
    recorder = McapRecorder(
        path,
        metadata={
            CONFIG_RECORD: {"json": json.dumps(config.model_dump(exclude={"replay"}))},
            "mapfuse.clock": {"wall_minus_monotonic_ns": str(clock.offset_ns)},
            "mapfuse.origin": {"simulated": str(is_emulated(stream.serial)).lower(), "lidar_serial": stream.serial},
        },
    )
    recorder.put(laser_pose)
    return recorder


def _discard(_message: Recordable) -> None:
    """Stand in for a recorder where none is wanted."""


class _OnMapped:
    """What is done with each pose: the car is followed on a saved map, the live map recorded, and progress told."""

    def __init__(
        self, flow: MappingFlow, localisation: Localisation | None, put: Callable[[Recordable], None], live_s: float
    ) -> None:
        self._flow = flow
        self._localisation = localisation
        self._put = put
        self._live_ns = round(live_s * 1e9)
        self._drawn_ns: int | None = None
        self._shown = self._begun = time.monotonic()

    def __call__(self, mapped: MappedScan) -> None:
        if self._localisation is not None:
            self._localisation.add(mapped)
        self._record_map(mapped.stamp_ns)
        now = time.monotonic()
        if now - self._shown < _PROGRESS_S:
            return
        self._shown = now
        x, y, _ = mapped.pose
        log.info("%5.0f s  %5d scans  x %6.2f m  y %6.2f m", now - self._begun, self._flow.scans, x, y)

    def _record_map(self, stamp_ns: int) -> None:
        """Record the map as it is now, if the last time is long enough ago."""
        live = self._flow.mapper.live_grid
        if live is None:
            return
        if self._drawn_ns is None:
            self._drawn_ns = stamp_ns
        elif stamp_ns - self._drawn_ns >= self._live_ns:
            self._drawn_ns = stamp_ns
            self._put(grid_snapshot(live.grid(), stamp_ns))


def _session_details(stream: LidarStream, outcome: LiveOutcome, recorded: RecordingReport | None) -> Report:
    """Return what only a live session knows."""
    if outcome.dropped_scans:
        log.warning("%d scans were dropped: mapping was too slow for them", outcome.dropped_scans)
    details: Report = {
        "simulated": is_emulated(stream.serial),
        "lidar": {"model": stream.model, "firmware": stream.firmware, "serial": stream.serial, "mode": stream.mode},
        "dropped_scans": outcome.dropped_scans,
        "decoder": decoding_summary(outcome.streams),
        "fault": None if outcome.fault is None else str(outcome.fault),
    }
    if recorded is not None:
        details["recording"] = {
            "file": recorded.path.name,
            "bytes": recorded.bytes,
            "written": dict(recorded.written),
            "dropped": dict(recorded.dropped),
            "error": recorded.error,
        }
        if recorded.error:
            log.warning("%s", recorded.error)
        if recorded.dropped:
            log.warning("the recording has gaps: %s", dict(recorded.dropped))
    return details


def session_is_whole(report: Report) -> bool:
    """Whether no scan was dropped and nothing is missing from the recording, if one was asked for."""
    recording = report.get("recording") or {"error": None, "dropped": {}}
    return not (report["dropped_scans"] or recording["error"] or recording["dropped"])


def _log_end(report: Report, folder: Path) -> None:
    scans, trajectory, decoder = (report[key] for key in ("scans", "trajectory", "decoder"))
    log.info(
        "%d scans mapped, %d dropped; %d points decoded; %.2f m driven: %s",
        scans["mapped"],
        report["dropped_scans"],
        decoder.get("samples", 0),
        trajectory["length_m"],
        folder,
    )
