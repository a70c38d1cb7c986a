"""Depth in a replay: which camera took the images, and the poses that came with them."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.errors import RecordingError
from drivers.messages import DepthImage, Message, Odometry, Transform
from drivers.recording_reader import Recording
from mapping.depth_projection import CameraMount
from tools.config import Config
from tools.depth_flow import DepthFlow
from tools.pipeline import Setup
from tools.recorded_ground import RecordedGround, recorded_ground


class DepthReplay:
    """What a recording knows of the camera: `flow` is None where it holds no depth."""

    def __init__(self, recording: Recording, config: Config, setup: Setup, *, has_lidar: bool) -> None:
        self._recording = recording
        self._setup = setup
        self._only_recorded = config.odometry.source == "recorded"
        wants_poses = self._only_recorded or config.depth.tilt == "recorded"
        self._ground: RecordedGround | None = recorded_ground(recording, config) if wants_poses else None
        self._poses = None if self._ground is None else self._ground.poses
        has_depth = recording.depth_topic is not None
        self.flow = DepthFlow(config, self._mount_of, alone=not has_lidar) if has_depth else None

    def messages(self, scan_topic: str | None) -> Iterator[Message]:
        """Yield the recording's messages; recorded poses, where they are asked for, stand for wheel odometry.

        Raises RecordingError at the end if there were none.
        """
        found = 0
        for message in self._recording.messages(scan_topic):
            if self._poses is not None and isinstance(message, Transform):
                pose = self._poses.add(message)
                if self._only_recorded and pose is not None:
                    found += 1
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
        if self._ground is None or not self._ground.of_camera:
            return self._setup.camera_source
        return f"its poses in the recording; {self._ground.level}"

    def details(self) -> dict[str, object]:
        """Return what the report says of the camera."""
        if self.flow is None:
            return {}
        mount = self._setup.camera
        return {
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
            }
        }

    def _mount_of(self, _image: DepthImage) -> CameraMount:
        return self._tilt() or self._setup.camera

    def _tilt(self) -> CameraMount | None:
        """Return the mount of a camera that the recording has tracked itself."""
        return None if self._poses is None else self._poses.mount
