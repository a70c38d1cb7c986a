"""From depth pixels to points in base_link: the numpy projection, which every other one must agree with.

A pixel (u, v) of depth z lies at ((u - cx) z / fx, (v - cy) z / fy, z) in the optical frame (x right, y down, z ahead);
the camera's mount turns that into base_link. Gravity is taken to point along -z of base_link: the car stands level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Self

from drivers.messages import DepthImage, Pinhole

FloatArray = NDArray[np.float64]

# Axes of the optical frame (columns: right, down, ahead) in the camera's body frame (ahead, left, up), REP-103.
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Where camera_depth_optical_frame sits on base_link: the place of its origin, and how the camera is turned.

    roll, pitch and yaw turn the camera's body (x ahead, y left, z up), in this order about the fixed axes of base_link:
    all 0 for one that looks straight ahead; a positive pitch looks down, a positive yaw to the left.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.2
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0

    @classmethod
    def from_matrix4(cls, T_base_optical: ArrayLike) -> Self:
        """Return the mount whose T_base_optical (4, 4) is given, as calibrations state it."""
        matrix = np.asarray(T_base_optical, dtype=np.float64)
        turn = matrix[:3, :3] @ _R_BODY_OPTICAL.T
        pitch = math.atan2(-turn[2, 0], math.hypot(turn[2, 1], turn[2, 2]))
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
        x, y, z = matrix[:3, 3].tolist()
        return cls(x, y, z, roll, pitch, yaw)

    @property
    def T_base_optical(self) -> FloatArray:  # noqa: N802 (a pose is named after its frames)
        """The pose of the optical frame in base_link, (4, 4)."""
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        turn = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        pose = np.eye(4)
        pose[:3, :3] = turn @ _R_BODY_OPTICAL
        pose[:3, 3] = self.x_m, self.y_m, self.z_m
        return pose


class Projection(Protocol):
    """Turns the measured pixels of a depth image into points (N, 3) in base_link, m, in any order."""

    def __call__(self, image: DepthImage, mount: CameraMount) -> FloatArray:
        """Return the points of an image that a camera took from its mount."""
        ...


def pixel_rays(camera: Pinhole, mount: CameraMount) -> FloatArray:
    """Return where in base_link, seen from the optical centre, each pixel looks: (rows, cols, 3) for a depth of 1."""
    right = (np.arange(camera.width) - camera.cx) / camera.fx
    down = (np.arange(camera.height) - camera.cy) / camera.fy
    optical = np.empty((camera.height, camera.width, 3))
    optical[..., 0], optical[..., 1], optical[..., 2] = right, down[:, np.newaxis], 1.0
    return np.asarray(optical @ mount.T_base_optical[:3, :3].T)


def project(image: DepthImage, mount: CameraMount) -> FloatArray:
    """Return the points (N, 3) in base_link of all measured pixels, in m, row by row from the top left."""
    rays = _known_rays(image.camera, mount)
    seen = np.flatnonzero(image.depth)
    points = np.take(rays, seen, axis=0)
    points *= (np.take(image.depth.ravel(), seen) * image.unit_m)[:, np.newaxis]
    points += (mount.x_m, mount.y_m, mount.z_m)
    return points


@lru_cache(maxsize=2)
def _known_rays(camera: Pinhole, mount: CameraMount) -> FloatArray:
    """Return pixel_rays as (rows * cols, 3), computed once for a camera that stays where it is."""
    rays = pixel_rays(camera, mount).reshape(-1, 3)
    rays.setflags(write=False)
    return rays
