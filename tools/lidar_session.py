"""A session with a lidar, a depth camera or both: start them, record them, map them, save what came of it."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DriverError
from drivers.messages import Recordable
from drivers.recording_writer import McapRecorder, RecordingReport
from drivers.rplidar_decoder import load_compiled
from mapping.graph_state import GraphState
from mapping.grid import OccupancyGrid
from mapping.mount import Mount
from mapping.slam import MappedScan
from tools.clock import RunClock
from tools.config import Config, ConfigError
from tools.depth_flow import DepthFlow, scan_mount
from tools.live_run import QUEUE_FRESH, QUEUE_SCANS, LiveOutcome, Put, record_live, run_live
from tools.live_sensors import LiveSensors, started_sensors
from tools.pipeline import (
    CAMERA_FRAME,
    LASER_FRAME,
    MappingFlow,
    resolve_camera_mount,
    resolve_mount,
    search_thread,
    warm_up,
)
from tools.replay_run import CONFIG_RECORD
from tools.results import Report, decoding_summary, grid_snapshot, remarks, save_results
from tools.session_parts import LiveSession, SessionPart, going_along
from tools.signals import Stop

log = logging.getLogger(__name__)

RECORDING_NAME = "recording.mcap"
_PROGRESS_S = 2.0


@dataclass(frozen=True, slots=True)
class SensorPorts:
    """Where the sensors are, as the command line names them; None: there is none."""

    lidar: str | None = None
    camera: str | None = None

    def __str__(self) -> str:
        return " and ".join(port for port in (self.lidar, self.camera) if port is not None)


def run_session(
    ports: SensorPorts,
    config: Config,
    new_folder: Callable[[], Path],
    stop: Stop,
    *,
    record: bool,
    resume: GraphState | None = None,
    parts: Sequence[SessionPart] = (),
    clock: RunClock | None = None,
) -> tuple[Report, DriverError | None]:
    """Map live with a lidar, a camera or both until `stop`; parts go along.

    Return the report and the fault that ended the run early, once all is saved. Map, trajectory and state are saved,
    then refined and saved again; another signal meanwhile leaves that out. Raises DriverError when a sensor cannot be
    started, ConfigError for settings of replays: nothing is written then.
    """
    if config.odometry.source != "kiss":
        raise ConfigError(
            f"odometry.source: {config.odometry.source} is for replays of recordings with odometry or poses: a lidar or"
            " a camera has no wheels"
        )
    clock = clock or RunClock()
    warm_up()
    with search_thread() as background, started_sensors(ports.lidar, ports.camera, config, clock) as sensors:
        folder = new_folder()
        depth = _depth_flow(sensors, config)
        mount = _scanner_mount(sensors, config)
        live = (record and config.grid.live_s > 0) or any(part.needs_map for part in parts)
        flow = MappingFlow(config, mount, background=background, resume=resume, live=live, depth=depth)
        recorder = _start_recording(folder / RECORDING_NAME, config, clock, sensors) if record else None
        put: Put = _discard if recorder is None else recorder.put
        try:
            session = LiveSession(
                clock, mount, put, stop, _grid_now(flow), folder, trajectory_now=lambda: flow.mapper.trajectory
            )
            with going_along(parts, session):
                outcome = run_live(
                    sensors.lidar,
                    flow,
                    stop,
                    put=_Heard(put, parts),
                    on_mapped=_OnMapped(flow, parts, put, config.grid.live_s),
                    release=sensors.close,
                    camera=sensors.camera,
                    queue_scans=QUEUE_FRESH if any(part.hurries for part in parts) else QUEUE_SCANS,
                )
            if len(flow.mapper.trajectory):
                put(grid_snapshot(flow.maps()["map"], int(flow.mapper.trajectory.stamps_ns[-1])))
        finally:
            recorded = None if recorder is None else recorder.close()
    details = _session_details(sensors, outcome, recorded)
    for part in parts:
        details.update(part.save(folder))
    if depth is not None:
        details["depth"] = {**depth.summary(), "dropped_before_mapping": outcome.dropped_images}
    report = save_results(folder, flow, str(ports), details, save_state=True)
    asked = stop.asked
    if config.slam.refine and report["trajectory"]["poses"]:
        log.info("saved; refining the map (Ctrl-C again to leave that out)")
        if flow.refine(lambda: stop.asked > asked):
            report = save_results(folder, flow, str(ports), details, save_state=True)
    for line in remarks(report):
        log.warning("%s", line)
    _log_end(report, folder)
    return report, outcome.fault


def record_session(
    lidar_port: str | None, config: Config, path: Path, stop: threading.Event, *, camera_port: str | None = None
) -> tuple[Report, DriverError | None]:
    """Record until `stop`; return the report and the fault that ended the recording early."""
    clock = RunClock()
    load_compiled()
    with started_sensors(lidar_port, camera_port, config, clock) as sensors:
        recorder = _start_recording(path, config, clock, sensors)
        try:
            outcome = record_live(sensors.lidar, stop, put=recorder.put, camera=sensors.camera)
        finally:
            recorded = recorder.close()
    report = _session_details(sensors, outcome, recorded)
    written = ", ".join(f"{count} on {topic}" for topic, count in sorted(recorded.written.items()))
    log.info("%s: %d bytes; %s", path, recorded.bytes, written)
    return report, outcome.fault


def _scanner_mount(sensors: LiveSensors, config: Config) -> Mount:
    """Return where the scans that the car is located by are taken from."""
    places = [*sensors.places]
    if sensors.lidar is None:
        return scan_mount(resolve_camera_mount(places, config, None, CAMERA_FRAME)[0])
    return resolve_mount(places, config, None, LASER_FRAME)[0]


def _depth_flow(sensors: LiveSensors, config: Config) -> DepthFlow | None:
    if sensors.camera is None:
        return None
    mount, _ = resolve_camera_mount([*sensors.places], config, None, CAMERA_FRAME)
    return DepthFlow(config, lambda _: mount, alone=sensors.lidar is None)


def _start_recording(path: Path, config: Config, clock: RunClock, sensors: LiveSensors) -> McapRecorder:
    """Create the recording and enter what replay needs before the first byte: configuration, clock, sensors' places."""
    recorder = McapRecorder(
        path,
        metadata={
            CONFIG_RECORD: {"json": json.dumps(config.model_dump(exclude={"replay"}))},
            "mapfuse.clock": {"wall_minus_monotonic_ns": str(clock.offset_ns)},
            "mapfuse.origin": sensors.origin,
        },
    )
    for place in sensors.places:
        recorder.put(place)
    return recorder


def _grid_now(flow: MappingFlow) -> Callable[[], OccupancyGrid] | None:
    return None if flow.mapper.live_grid is None else flow.mapper.live_grid.grid


def _discard(_message: Recordable) -> None:
    """Stand in for a recorder where none is wanted."""


class _Heard:
    """Records a message and lets the parts know of it; of tools.live_run's calls those in the threads that read."""

    def __init__(self, put: Put, parts: Sequence[SessionPart]) -> None:
        self._put, self._parts = put, parts

    def __call__(self, message: Recordable) -> None:
        self._put(message)
        for part in self._parts:
            part.note(message)


class _OnMapped:
    """What is done with each pose: the parts are told, the live map is recorded, and progress told."""

    def __init__(self, flow: MappingFlow, parts: Sequence[SessionPart], put: Put, live_s: float) -> None:
        self._flow = flow
        self._parts = parts
        self._put = put
        self._tells = not any(part.tells for part in parts)
        self._live_ns = round(live_s * 1e9)
        self._drawn_ns: int | None = None
        self._shown = self._begun = time.monotonic()

    def __call__(self, mapped: MappedScan) -> None:
        for part in self._parts:
            part.add(mapped)
        self._record_map(mapped.stamp_ns)
        now = time.monotonic()
        if not self._tells or now - self._shown < _PROGRESS_S:
            return
        self._shown = now
        x, y, _ = mapped.pose
        log.info("%5.0f s  %5d scans  x %6.2f m  y %6.2f m", now - self._begun, self._flow.scans, x, y)

    def _record_map(self, stamp_ns: int) -> None:
        """Record the map as it is now, if the last time is long enough ago."""
        live = self._flow.mapper.live_grid
        if live is None or self._live_ns == 0:
            return
        if self._drawn_ns is None:
            self._drawn_ns = stamp_ns
        elif stamp_ns - self._drawn_ns >= self._live_ns:
            self._drawn_ns = stamp_ns
            self._put(grid_snapshot(live.grid(), stamp_ns))


def _session_details(sensors: LiveSensors, outcome: LiveOutcome, recorded: RecordingReport | None) -> Report:
    """Return what only a live session knows."""
    if outcome.dropped_scans:
        log.warning("%d scans were dropped: mapping was too slow for them", outcome.dropped_scans)
    details: Report = {
        **sensors.summary(),
        "dropped_scans": outcome.dropped_scans,
        "decoder": decoding_summary(outcome.streams),
        "fault": None if outcome.fault is None else str(outcome.fault),
        "camera_fault": None if outcome.camera_fault is None else str(outcome.camera_fault),
        **({} if outcome.speed_hz is None else {"turns_per_s": round(outcome.speed_hz, 2)}),
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
    """Whether no scan was dropped, no camera lost, and nothing is missing from the recording, if one was asked for.

    A car that drives leaves out scans on purpose, rather than look at old ones.
    """
    recording = report.get("recording") or {"error": None, "dropped": {}}
    dropped = 0 if "drive" in report else report["dropped_scans"]
    return not (dropped or report["camera_fault"] or recording["error"] or recording["dropped"])


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
