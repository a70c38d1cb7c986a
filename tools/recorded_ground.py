"""Where the floor is under the poses of a recording: known by convention, or found where only gravity is told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

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
_UPRIGHT = 0.5  # of a camera's own up that points up, in a level world: 60 deg off
_LEAST_HEIGHT_M = 0.05
_RIGID_M, _RIGID_RAD = 0.1, np.radians(5.0)  # how far the height and tilt of a camera on a car may seem to change


@dataclass(frozen=True, slots=True, eq=False)
class RecordedGround:
    """Follows the poses of a recording over its floor.

    of_camera: they are those of the camera itself. level: how the floor is known, in words.
    """

    poses: RecordedPoses
    of_camera: bool
    level: str


def recorded_ground(recording: Recording, config: Config, camera_frame: str = CAMERA_FRAME) -> RecordedGround:
    """Return what follows the poses of a recording.

    Where the recording tells the direction of gravity, which is none of ROS's business, the floor is looked for in the
    images. Else the root is level with the floor at z = 0, as ROS has it, if the camera stands upright above it so; and
    else, as where the first camera's frame is the world, the camera's mount on the car tells what is level, if the
    camera keeps height and tilt. Raises RecordingError where none of it holds.
    """
    bases = base_frames(config.replay.base_frame)
    gravity = recording.metadata.get("depth_folder", {}).get(GRAVITY)
    if gravity is not None:
        try:
            level = levelled(_direction(gravity))
        except ValueError as error:
            raise RecordingError(f"{recording.path}: {GRAVITY} is not a direction of three numbers") from error
        level[2, 3] = -floor_height(_heights(recording.messages(), level))
        return RecordedGround(RecordedPoses(bases, camera_frame, level), of_camera=True, level=f"down as in {GRAVITY}")
    places = _camera_places(recording.messages(), RecordedPoses(bases, camera_frame, np.eye(4)))
    level, words = (np.eye(4), "the poses' world is level") if _stands_upright(places) else _as_mounted(places, config)
    if words is None:
        raise RecordingError(
            f"{recording.path}: nothing tells where down is: the camera's poses are neither upright above z = 0 nor of"
            f" one height and tilt, as on a car: put gravity's direction in their world, three numbers, into {GRAVITY}"
        )
    return RecordedGround(RecordedPoses(bases, camera_frame, level), of_camera=len(places) > 0, level=words)


def _direction(text: str) -> FloatArray:
    """Return a vector (3,) of some length; raises ValueError where there is none."""
    vector = np.array(text.split(), dtype=np.float64).reshape(3)
    if not (np.isfinite(vector).all() and vector.any()):
        raise ValueError(f"{vector} has no direction")
    return vector


def _camera_places(messages: Iterable[Message], poses: RecordedPoses) -> FloatArray:
    """Return T_root_optical (N, 4, 4) of a camera that was tracked itself; (0, 4, 4) where its car was, or nothing."""
    places = [np.zeros((0, 4, 4))]
    images = 0
    for message in messages:
        if isinstance(message, Transform):
            is_pose, place = poses.add(message) is not None, poses.camera_place
            if is_pose and place is None:
                return places[0]
            if is_pose and place is not None:
                places.append(place[np.newaxis])
        images += isinstance(message, DepthImage)
        if images >= _EVERY * _MOST_IMAGES:
            break
    return np.concatenate(places)


def _stands_upright(places: FloatArray) -> bool:
    """Whether the root is level with the floor at z = 0, as far as the places of a camera tell."""
    if len(places) == 0:
        return True
    up, height_m = -places[:, 2, 1], places[:, 2, 3]
    return bool(np.median(up) > _UPRIGHT and np.median(height_m) > _LEAST_HEIGHT_M)


def _as_mounted(places: FloatArray, config: Config) -> tuple[FloatArray, str | None]:
    """Return T_level_root (4, 4) by which the camera sits as on its car, and words for it; None if it moves on it."""
    T_base_optical = config.camera_mount().T_base_optical
    T_level_root = T_base_optical @ np.linalg.inv(places[0])
    found = T_level_root @ places
    off_m = np.abs(found[:, 2, 3] - T_base_optical[2, 3])
    off_rad = np.arccos(np.clip(found[:, 2, :3] @ T_base_optical[2, :3], -1.0, 1.0))
    if off_m.max() > _RIGID_M or off_rad.max() > _RIGID_RAD:
        return T_level_root, None
    return T_level_root, "level and height by config depth.mount"


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
