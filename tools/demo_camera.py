"""The demo's third car (thesis section 5.6): a depth camera and wheels, no lidar.

Its drive is simulated, not emulated in real time, so that rendering takes nothing away from the live cars: what it sees
goes into a recording, which is replayed as that of a real camera is.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from drivers.messages import Transform
from drivers.recording_writer import McapRecorder
from drivers.rotations import quaternion
from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import Trajectory, read_tum, write_tum
from tools.config import Config
from tools.demo_cars import DemoCar
from tools.demo_processes import Stopped, run_command
from tools.demo_scores import MappedCar, score_alignment, score_common
from tools.errors import ToolError
from tools.exit_codes import ExitCode
from tools.mapped_drives import CameraSetup, camera_messages
from tools.pipeline import CAMERA_FRAME
from tools.results import Report
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import WINGS_WEST_TOUR, wings

CAMERA_CAR = DemoCar("C", "D435", "from the hall into the west wing", 0.05)
_BACK_FROM_THE_HALL = 18  # so many points of car A's way, the other way round
_SETUP = CameraSetup(size=(424, 240))
_SPEED_MPS = 0.5
_START_NS = 10**9
_QUEUE = 10_000  # the recorder must not drop what the simulation makes faster than it can write


def map_with_camera(folder: Path, seed: int, stopped: Stopped) -> MappedCar:
    """Simulate and record the drive, replay the recording, and return what came of it; raises ToolError."""
    once = drive_along(WINGS_WEST_TOUR[::-1][:_BACK_FROM_THE_HALL], _SPEED_MPS)
    truth = Trajectory(once.stamps_ns + _START_NS, once.poses)
    folder.mkdir()
    write_tum(folder / "truth.tum", truth)
    recording = folder / "recording.mcap"
    record_camera_drive(recording, truth, seed, stopped)
    run_command(stopped, "-q", "replay", str(recording), "-o", str(folder / "replay"))
    return MappedCar(CAMERA_CAR, read_map(folder / "replay/map.npz"), read_tum(folder / "replay/trajectory.tum"), truth)


def record_camera_drive(path: Path, truth: Trajectory, seed: int, stopped: Stopped = lambda: False) -> None:
    """Record what camera and wheels of a car tell on a drive through the wings, labelled simulated.

    Raises RecordingError when the file cannot be created, ToolError when it is not complete.
    """
    config = Config()
    pose = config.camera_mount().T_base_optical
    place = Transform(_START_NS, "base_link", CAMERA_FRAME, pose[:3, 3], quaternion(pose[:3, :3]), static=True)
    origin = {"mapfuse.origin": {"simulated": "true"}}
    with McapRecorder(path, metadata=origin, queue_limit=_QUEUE, depth_limit=_QUEUE) as recorder:
        recorder.put(place)
        for message in camera_messages(solid(wings()), truth, config, _SETUP, seed):
            if stopped():
                raise KeyboardInterrupt
            recorder.put(message)
    report = recorder.close()
    if report.error or report.dropped:
        raise ToolError(f"{path}: the simulated drive is not complete: {report.error or dict(report.dropped)}")


def fuse_with_camera(
    folder: Path, lidar: MappedCar, lidar_map: Path, camera: MappedCar, seed: int, stopped: Stopped
) -> Report:
    """Fuse the camera's map, in its car's folder, with a lidar's and return how far that is from the truth."""
    maps = [str(lidar_map), str(folder / "replay/map.npz")]
    arguments = ["-q", "fuse", *maps, "-o", str(folder / "fused"), "--seed", str(seed)]
    run_command(stopped, *arguments, allowed=(ExitCode.OK, ExitCode.PARTIAL))
    fused: Report = json.loads((folder / "fused/report.json").read_text(encoding="utf-8"))
    pair = fused["pairs"][0]
    error = absolute_trajectory_error(camera.trajectory, camera.truth)
    found = [pair["dx"], pair["dy"], None if pair["dx"] is None else float(np.radians(pair["theta_deg"]))]
    return {
        "driven_m": round(camera.truth.length_m, 2),
        "trajectory_rms_m": round(error.rms_m, 4),
        "common": score_common(lidar, camera),
        "T_lidar_camera": None if found[2] is None else found,
        **score_alignment(lidar, camera, pair),
    }


def camera_line(scored: Report) -> str:
    """Return what became of the camera's map in one line for people."""
    error = ""
    if scored["rms_m"] is not None:
        error = f", error {scored['rms_m'] * 100:.1f} cm, {scored['rotation_deg']:.2f} deg"
    return f"{'fused' if scored['accepted'] else 'REFUSED, not fused'} with car A's lidar map{error}"
