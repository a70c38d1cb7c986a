"""Where a car or a camera in the hand goes, by the odometry of its depth images alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.messages import DepthImage
from mapping.cloud_odometry import CloudOdometry, CloudSettings
from mapping.depth_projection import CameraMount
from mapping.recorded_poses import below, planar

FloatArray = NDArray[np.float64]

_T_BODY_OPTICAL = CameraMount(z_m=0.0).T_base_optical


@dataclass(frozen=True, slots=True, eq=False)
class TrackedImage:
    """Pose (3,) of the car when it took an image, None where that could not be told, and where its camera sat then."""

    pose: FloatArray | None
    mount: CameraMount


class CameraTracking:
    """Follows a camera from image to image.

    in_hand: the camera is on no car. Its mount tells height and tilt at the first image; from there on gravity turns
    with it as the odometry says, and its car is the place on the floor below it. Else the mount is fixed, and the car
    is taken to stand level.
    """

    def __init__(self, settings: CloudSettings, *, in_hand: bool) -> None:
        self._odometry = CloudOdometry(settings)
        self._in_hand = in_hand
        self._T_level_first: FloatArray | None = None  # of the camera's body, at the first image that was matched
        self._mount: CameraMount | None = None

    def add(self, image: DepthImage, mount: CameraMount) -> TrackedImage:
        """Take in an image; mount: where the camera sits, or sat at the first image if it is in the hand."""
        T_first_body = self._odometry.add(image)
        if T_first_body is None:
            return TrackedImage(None, self._mount or mount)
        T_base_body = mount.T_base_optical @ np.linalg.inv(_T_BODY_OPTICAL)
        if self._T_level_first is None:
            self._T_level_first = T_base_body
        T_level_body = self._T_level_first @ T_first_body
        if self._in_hand:
            pose, self._mount = below(T_level_body @ _T_BODY_OPTICAL)
            return TrackedImage(pose, self._mount)
        return TrackedImage(planar(T_level_body @ np.linalg.inv(T_base_body)), mount)
