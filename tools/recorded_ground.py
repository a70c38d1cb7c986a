"""Where the floor is under the poses of a recording: known by convention, or found where only gravity is told."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from drivers.errors import RecordingError
from drivers.messages import DepthImage, Message, Transform
from drivers.recording_reader import Recording
from mapping.depth_projection import CameraMount, project
from mapping.depth_thinning import Thinning, thinned
from mapping.frames import matrix4
from mapping.recorded_poses import RecordedPoses, floor_height, levelled
from tools.config import Config
from tools.pipeline import CAMERA_FRAME, base_frames

FloatArray = NDArray[np.float64]

GRAVITY = "gravity-direction.txt"  # of a folder of depth images: a vector in the world of its poses
_COARSE = Thinning(decimation=8)
_EVERY = 5
_MOST_IMAGES = 100


def recorded_poses(recording: Recording, config: Config, camera_frame: str = CAMERA_FRAME) -> RecordedPoses:
    """Return what follows the poses of a recording.

    Their root is level, with the floor at z = 0, as ROS has it; where the recording tells the direction of gravity,
    which is none of ROS's business, the floor is looked for in the images. Raises RecordingError.
    """
    gravity = recording.metadata.get("depth_folder", {}).get(GRAVITY)
    level = np.eye(4)
    if gravity is not None:
        try:
            level = levelled(np.array(gravity.split(), dtype=np.float64).reshape(3))
        except ValueError as error:
            raise RecordingError(f"{recording.path}: {GRAVITY} is not a vector of three numbers") from error
        level[2, 3] = -floor_height(_heights(recording.messages(), level))
    return RecordedPoses(base_frames(config.replay.base_frame), camera_frame, level)


def _heights(messages: Iterable[Message], T_level_root: FloatArray) -> FloatArray:
    """Return the heights (N,) of what a tracked camera saw in some of its images."""
    place: FloatArray | None = None
    heights = [np.zeros(0)]
    images = 0
    for message in messages:
        if isinstance(message, Transform):
            place = T_level_root @ matrix4(message)
        elif isinstance(message, DepthImage) and place is not None:
            if images % _EVERY == 0:
                heights.append(project(thinned(message, _COARSE), CameraMount.from_matrix4(place))[:, 2])
            images += 1
        if images >= _EVERY * _MOST_IMAGES:
            break
    return np.concatenate(heights)
