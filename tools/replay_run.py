"""A replay: a recording through the flow of a live run."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

from drivers.errors import RecordingError
from drivers.recording_reader import Recording
from mapping.graph_state import GraphState
from mapping.slam import MappedScan
from tools.config import Config, parse
from tools.depth_replay import DepthReplay, error_lines
from tools.localisation import Localisation
from tools.pipeline import LidarDecoding, MappingFlow, Setup, look_ahead
from tools.result_folder import MAPPED, new_results
from tools.results import Report, decoding_summary, remarks, save_results

CONFIG_RECORD = "mapfuse.config"  # name of the metadata record that holds a run's configuration
_PROGRESS_S = 5.0


def recorded_config(recording: Recording) -> Config:
    """Return the configuration that was recorded with the data, else the defaults; raise ConfigError."""
    text = recording.metadata.get(CONFIG_RECORD, {}).get("json")
    if text is None:
        return Config()
    try:
        values = json.loads(text)
    except ValueError as error:
        raise RecordingError(f"{recording.path}: its configuration is damaged: give --config: {error}") from error
    return parse(values, f"{recording.path} (recorded configuration)")


def replay_recording(
    recording: Recording,
    config: Config,
    output: Path | None,
    *,
    on_progress: Callable[[str], None],
    resume: GraphState | None = None,
    save_state: bool = False,
    map_file: Path | None = None,
) -> Report:
    """Map the recording, going on from an earlier drive where one is given, save the results and return the report.

    Raises RecordingError where there is neither lidar data nor depth in it; nothing is written then.
    """
    scan_topic = config.replay.scan_topic
    _refuse_unmappable(recording, config)
    setup = look_ahead(recording.messages(scan_topic), config)
    has_lidar = _has_lidar(recording, config)
    if has_lidar:
        on_progress(f"laser pose from {setup.mount_source}; order of samples: {setup.sweep.reason}")
    camera = DepthReplay(recording, config, setup, has_lidar=has_lidar)
    if recording.depth_topic is not None:
        on_progress(f"camera pose from {camera.mount_source}")
    decoding = LidarDecoding()
    flow = MappingFlow(
        config,
        setup.mount if has_lidar else camera.mount,
        sweep_reversed=setup.sweep.is_reversed,
        resume=resume,
        depth=camera.flow,
    )
    started = shown = time.monotonic()
    last: MappedScan | None = None
    localisation = None if map_file is None else Localisation(map_file, flow.mapper.mount.pose[:2])
    for message in camera.messages(scan_topic):
        for decoded in decoding.feed(message):
            for mapped in flow.feed(decoded):
                last = mapped
                if localisation is not None:
                    localisation.add(mapped)
        if time.monotonic() - shown > _PROGRESS_S:
            shown = time.monotonic()
            on_progress(
                f"{flow.scans} {'scans' if has_lidar else 'images'}, {flow.mapper.trajectory.length_m:.1f} m driven"
            )
    for mapped in flow.finish():
        last = mapped
        if localisation is not None:
            localisation.add(mapped)
    flow.refine()
    _refuse_unmapped(recording, flow, last)
    for problem in recording.problems:
        on_progress(f"damaged recording: {problem}")
    error = camera.trajectory_error(flow.mapper.trajectory)
    folder = new_results(output, MAPPED)
    report = save_results(
        folder,
        flow,
        str(recording.path),
        {
            "truncated": recording.truncated,
            "problems": recording.problems,
            "skipped_types": recording.skipped,
            **(_lidar_details(recording, config, setup, decoding) if has_lidar else {}),
            **camera.details(error),
            **({} if localisation is None else {"localisation": localisation.save(folder)}),
        },
        save_state=save_state,
    )
    for line in [*error_lines(error), *remarks(report)]:
        on_progress(line)
    on_progress(closing_line(report, folder, time.monotonic() - started))
    return report


def _lidar_details(recording: Recording, config: Config, setup: Setup, decoding: LidarDecoding) -> Report:
    return {
        "scan_source": config.replay.scan_topic or recording.scan_topic or "raw bytes",
        "laser_pose": {
            "source": setup.mount_source,
            "x_m": float(setup.mount.pose[0]),
            "y_m": float(setup.mount.pose[1]),
            "yaw_rad": float(setup.mount.pose[2]),
            "inverted": setup.mount.inverted,
        },
        "sweep": {"reversed": setup.sweep.is_reversed, "reason": setup.sweep.reason},
        "decoder": decoding_summary(decoding.counters),
    }


def _has_lidar(recording: Recording, config: Config) -> bool:
    return recording.has_raw or recording.scan_topic is not None or config.replay.scan_topic is not None


def _refuse_unmappable(recording: Recording, config: Config) -> None:
    """Raise RecordingError for a recording without what is to be mapped, or without the poses that are asked for."""
    if not _has_lidar(recording, config) and recording.depth_topic is None:
        held = ", ".join(sorted({topic.type for topic in recording.topics if topic.count}))
        raise RecordingError(f"{recording.path}: no LaserScan, raw lidar bytes or depth to map; it holds {held}")
    if config.odometry.source == "wheel" and recording.odometry_topic is None:
        raise RecordingError(f"{recording.path}: no nav_msgs/msg/Odometry in it; leave out --odometry wheel")


def _refuse_unmapped(recording: Recording, flow: MappingFlow, last: MappedScan | None) -> None:
    """Raise RecordingError where nothing came of the scans, with the reason for the last of them."""
    noun = "images" if flow.depth is not None and flow.depth.alone else "scans"
    damage = f" (damaged: {recording.problems[0]})" if recording.problems else ""
    if not flow.scans:
        raise RecordingError(f"{recording.path}: its data does not make up one scan; nothing to map{damage}")
    if not flow.mapper.counters.mapped:
        why = last.match.reason if last is not None else "all partial or out of order"
        raise RecordingError(f"{recording.path}: none of its {flow.scans} {noun} can be mapped: {why}{damage}")


def closing_line(report: Report, folder: Path, seconds: float) -> str:
    """Return the closing line."""
    scans, trajectory, timing = report["scans"], report["trajectory"], report["timing"]
    pace = f"{timing['per_scan_ms_median']:.1f} ms each, " if timing else ""
    factor = trajectory["duration_s"] / max(seconds, 1e-9)
    lost = {"unmatched": "unmatched", "skipped_partial": "partial", "skipped_out_of_order": "out of order"}
    others = "".join(f", {scans[key]} {name}" for key, name in lost.items() if scans[key])
    unplaced = scans["mapped"] - scans["in_map"]
    others += f", {unplaced} in pieces without a place in the map" if unplaced > 0 else ""
    passed = scans["received"] - scans["mapped"] - sum(scans[key] for key in lost)
    others += f", {passed} passed over" if passed > 0 else ""
    noun = "scans" if "scan_source" in report else "images"
    mapped = f"{scans['in_map']} of {scans['received']} {noun} mapped{others}"
    driven = f"{trajectory['length_m']:.2f} m driven"
    return f"{mapped} in {seconds:.1f} s ({pace}{factor:.0f} x real time), {driven}: {folder}"
