"""Depth in a replay: which camera took the images, and the poses that came with them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.messages import DepthImage, Message, Odometry, Transform
from drivers.recording_reader import Recording
from mapping import se2
from mapping.depth_projection import CameraMount
from mapping.metrics import TrajectoryError2D, absolute_trajectory_error
from mapping.mount import Mount
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.depth_flow import DepthFlow, scan_mount
from tools.pipeline import CAMERA_FRAME, Setup
from tools.recorded_ground import RecordedGround, recorded_ground

FloatArray = NDArray[np.float64]


class DepthReplay:
    """What a recording knows of the camera: `flow` is None where it holds no depth."""

    def __init__(self, recording: Recording, config: Config, setup: Setup, *, has_lidar: bool) -> None:
        self._recording = recording
        self._setup = setup
        self._only_recorded = config.odometry.source == "recorded"
        has_depth = recording.depth_topic is not None
        self._in_hand = config.depth.tilt != "mount"
        self._tilt_recorded = self._only_recorded or self._in_hand
        self._ground: RecordedGround | None = None
        if self._only_recorded or config.depth.tilt == "recorded":
            self._ground = recorded_ground(recording, config)
        elif has_depth and not has_lidar:
            with suppress(RecordingError):  # then the poses are not needed, but only compared with
                self._ground = recorded_ground(recording, config)
        self._poses = None if self._ground is None else self._ground.poses
        self._way: list[Odometry] = []  # as recorded
        self.flow = DepthFlow(config, self._mount_of, alone=not has_lidar) if has_depth else None

    def messages(self, scan_topic: str | None) -> Iterator[Message]:
        """Yield the recording's messages; recorded poses, where they are asked for, stand for wheel odometry.

        Raises RecordingError at the end if there were none.
        """
        found = 0
        for message in self._recording.messages(scan_topic):
            if self._poses is not None and isinstance(message, Transform):
                pose = self._poses.add(message)
                if pose is not None:
                    found += 1
                    self._way.append(pose)
                if self._only_recorded and pose is not None:
                    yield pose
            if not (self._only_recorded and isinstance(message, Odometry)):
                yield message
        if self._only_recorded and not found:
            damage = f" (damaged: {self._recording.problems[0]})" if self._recording.problems else ""
            raise RecordingError(
                f"{self._recording.path}: no poses of the car or its camera in it{damage}; "
                "leave out --odometry recorded"
            )

    @property
    def mount_source(self) -> str:
        """Where it is told how the camera sits, in words."""
        if self._ground is None or not (self._tilt_recorded and self._ground.of_camera):
            return self._setup.camera_source
        which = "its poses" if self.flow is None or not self.flow.tracks else "its first pose"
        return f"{which} in the recording; {self._ground.level}"

    @property
    def mount(self) -> Mount:
        """Where the laser would sit that gives the camera's scans: a camera in the hand is its own car."""
        return scan_mount(CameraMount() if self._in_hand else self._setup.camera)

    def trajectory_error(self, found: Trajectory) -> TrajectoryError2D | None:
        """Return how far the car's poses are from those that were recorded; None where there are none."""
        rising = {pose.stamp_ns: pose for pose in self._way}
        if self._only_recorded or len(rising) < 2 or len(found) < 2:
            return None
        stamps = np.array(sorted(rising), dtype=np.int64)
        if self._way[0].child_frame_id == CAMERA_FRAME:
            found = replace(found, poses=se2.compose(found.poses, self._place()))
        try:
            true = Trajectory(stamps, np.array([rising[stamp].pose for stamp in stamps.tolist()]))
            return absolute_trajectory_error(found, true)
        except ValueError:
            return None  # they are from another time

    def details(self, error: TrajectoryError2D | None) -> dict[str, object]:
        """Return what the report says of the camera, and of the error of its poses."""
        if self.flow is None:
            return {}
        mount = self._setup.camera
        return {
            **({} if error is None else {"trajectory_error": asdict(error)}),
            "depth": {
                "topic": self._recording.depth_topic,
                **self.flow.summary(),
                "camera_pose": {
                    "source": self.mount_source,
                    "x_m": mount.x_m,
                    "y_m": mount.y_m,
                    "z_m": mount.z_m,
                    "roll_rad": mount.roll_rad,
                    "pitch_rad": mount.pitch_rad,
                    "yaw_rad": mount.yaw_rad,
                },
            },
        }

    def _mount_of(self, _image: DepthImage) -> CameraMount:
        return self._tilt() or self._setup.camera

    def _tilt(self) -> CameraMount | None:
        """Return the mount of a camera that the recording has tracked itself."""
        return self._poses.mount if self._tilt_recorded and self._poses is not None else None

    def _place(self) -> FloatArray:
        """Return the pose (3,) on the car of what is headed where the camera looks."""
        mount = CameraMount() if self._in_hand else self._setup.camera
        return np.array([mount.x_m, mount.y_m, mount.yaw_rad])


def error_lines(error: TrajectoryError2D | None) -> list[str]:
    """Return what is told of it."""
    if error is None:
        return []
    off = f"{error.rms_m:.3f} m RMS, at most {error.max_m:.2f} m, and {error.rms_deg:.1f} deg RMS"
    return [f"off {error.poses} recorded poses by {off} (frames aligned in the plane)"]
