"""Depth odometry in six degrees of freedom: the points of each image against a local map, by kiss-icp.

Source: Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP" (RA-L 2023), with its two densities of points and its
adaptive threshold. Neither a floor nor gravity is made use of. The frame is the camera's body (x ahead, y left, z up).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from kiss_icp.mapping import get_voxel_hash_map
from kiss_icp.registration import get_registration
from kiss_icp.threshold import get_threshold_estimator
from kiss_icp.voxelization import voxel_down_sample
from numpy.typing import NDArray

from drivers.messages import DepthImage
from mapping.depth_projection import CameraMount, project
from mapping.depth_thinning import Thinning, thinned
from mapping.odometry import LocalMapSettings, kiss_config

FloatArray = NDArray[np.float64]

_BODY = CameraMount(z_m=0.0)
_LONGEST_GUESS = 3.0  # intervals: what the camera did then is no guess for a longer gap


@dataclass(frozen=True, slots=True)
class CloudSettings(LocalMapSettings):
    """How clouds are matched; lengths in metres.

    thinning: what is kept of an image. voxel_m: of the local map, which reaches map_radius_m and keeps one point each
    half a voxel; one each voxel and a half is matched. first_threshold_m, least_motion_m: of the adaptive threshold. An
    image with fewer than min_points such points is not matched.
    """

    thinning: Thinning = field(default_factory=lambda: Thinning(decimation=4, nearest_m=0.4))
    voxel_m: float = 0.1
    map_radius_m: float = 5.0
    points_per_voxel: int = 20
    first_threshold_m: float = 0.3
    least_motion_m: float = 0.02
    convergence: float = 1e-4
    min_points: int = 60


class CloudOdometry:
    """Holds the local map from image to image."""

    def __init__(self, settings: CloudSettings) -> None:
        config = kiss_config(settings)
        config.adaptive_threshold.initial_threshold = settings.first_threshold_m
        config.adaptive_threshold.min_motion_th = settings.least_motion_m
        self._settings = settings
        self._local_map = get_voxel_hash_map(config)
        self._registration = get_registration(config)
        self._threshold = get_threshold_estimator(config)
        self._last: tuple[int, FloatArray] | None = None  # stamp and pose of the last image that was matched
        self._motion = np.eye(4)  # from the one before to it,
        self._interval_ns = 0  # in this time

    def add(self, image: DepthImage) -> FloatArray | None:
        """Take in an image, later than the last; return T_first_this (4, 4), None for one with too little to see."""
        points = project(thinned(image, self._settings.thinning), _BODY)
        kept = np.asarray(voxel_down_sample(points, 0.5 * self._settings.voxel_m))
        source = np.asarray(voxel_down_sample(kept, 1.5 * self._settings.voxel_m))
        if len(source) < self._settings.min_points:
            return None
        guess = self._guess(image.stamp_ns)
        pose = guess if self._last is None else self._matched(source, guess)
        self._local_map.update(kept, pose)
        if self._last is not None:
            self._interval_ns = image.stamp_ns - self._last[0]
            self._motion = np.linalg.inv(self._last[1]) @ pose
        self._last = (image.stamp_ns, pose)
        return pose

    def _matched(self, source: FloatArray, guess: FloatArray) -> FloatArray:
        sigma = self._threshold.get_threshold()
        pose = self._registration.align_points_to_map(
            points=source,
            voxel_map=self._local_map,
            initial_guess=guess,
            max_correspondance_distance=3.0 * sigma,
            kernel=sigma,
        )
        self._threshold.update_model_deviation(np.linalg.inv(guess) @ pose)
        return np.asarray(pose)

    def _guess(self, stamp_ns: int) -> FloatArray:
        """Return the pose (4, 4) if the camera moves on as it did."""
        if self._last is None:
            return np.eye(4)
        last_ns, last = self._last
        intervals = (stamp_ns - last_ns) / self._interval_ns if self._interval_ns > 0 else 1.0
        return np.asarray(last @ part_of(self._motion, intervals)) if intervals <= _LONGEST_GUESS else last


def part_of(motion: FloatArray, share: float) -> FloatArray:
    """Return a share of a rigid motion (4, 4): of its shift, and of its turn about the same axis (Rodrigues)."""
    turn = motion[:3, :3]
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = float(np.linalg.norm(axis)), float(np.trace(turn)) - 1.0  # twice each
    part = np.eye(4)
    part[:3, 3] = share * motion[:3, 3]
    if sine > 0.0:
        angle, (x, y, z) = share * math.atan2(sine, cosine), (axis / sine).tolist()
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        part[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return part
