"""Laser odometry: scan against local map with kiss-icp's registration, planar and without down-sampling.

Source: Vizzo et al., "KISS-ICP: In Defense of Point-to-Point ICP" (RA-L 2023). A single-layer scan has few points, so
none is thrown away (kiss-icp's stock pipeline keeps one a voxel, made for 3-D clouds), and the correspondence threshold
is fixed instead of adaptive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
from kiss_icp.config.parser import KISSConfig
from kiss_icp.mapping import get_voxel_hash_map
from kiss_icp.registration import get_registration
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LocalMapSettings:
    """kiss-icp's local map and when its registration ends; lengths in metres.

    map_radius_m: how far from the robot the local map reaches. voxel_m and points_per_voxel set the map's density.
    """

    map_radius_m: float = 15.0
    voxel_m: float = 0.25
    points_per_voxel: int = 10
    convergence: float = 1e-3
    max_iterations: int = 100


@dataclass(frozen=True, slots=True)
class OdometrySettings(LocalMapSettings):
    """How scans are matched; lengths in metres.

    threshold_m: scale of the robust kernel; pairs farther apart than three times that are ignored. rough_convergence,
    rough_iterations: for a match after which de-skewing is repeated. min_points: a scan with fewer measurements is not
    matched. max_correction_m and max_correction_rad: a match farther than that from the guess is not believed.
    """

    threshold_m: float = 0.25
    rough_convergence: float = 1e-2
    rough_iterations: int = 6
    min_points: int = 30
    max_correction_m: float = 1.0
    max_correction_rad: float = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class ScanMatch:
    """Pose (3,) of the body in the odom frame after a match, and how far it lies from the guess.

    accepted False: the pose is the guess, `reason` says why, and the local map did not learn from the scan.
    doubtful: it is the best there is, but may be at the wrong place altogether.
    """

    pose: FloatArray
    correction: FloatArray
    accepted: bool
    reason: str = ""
    doubtful: bool = False


def kiss_config(settings: LocalMapSettings) -> KISSConfig:
    """Return kiss-icp's configuration of a local map and of a registration that repeats bit for bit."""
    return KISSConfig(
        data=DataConfig(max_range=settings.map_radius_m, min_range=0.0, deskew=False),
        mapping=MappingConfig(voxel_size=settings.voxel_m, max_points_per_voxel=settings.points_per_voxel),
        registration=RegistrationConfig(
            max_num_iterations=settings.max_iterations,
            convergence_criterion=settings.convergence,
            max_num_threads=1,  # more gain nothing on a thousand points, and one is certain to repeat bit for bit
        ),
    )


class LidarOdometry:
    """Holds the local map from scan to scan."""

    def __init__(self, settings: OdometrySettings) -> None:
        config = kiss_config(settings)
        self._settings = settings
        self._local_map = get_voxel_hash_map(config)
        self._registration = get_registration(config)
        config.registration.max_num_iterations = settings.rough_iterations
        config.registration.convergence_criterion = settings.rough_convergence
        self._rough_registration = get_registration(config)

    def match(self, points: FloatArray, guess: FloatArray, *, rough: bool = False) -> ScanMatch:
        """Match de-skewed body-frame points (N, 2) to the local map from a guess (3,) of the pose; the map stays.

        rough: another match will follow, so a few steps are enough.
        """
        if len(points) < self._settings.min_points:
            reason = f"{len(points)} measurements, {self._settings.min_points} needed"
            return ScanMatch(guess, se2.IDENTITY, accepted=False, reason=reason)
        if self._local_map.empty():
            return ScanMatch(guess, se2.IDENTITY, accepted=True)
        registration = self._rough_registration if rough else self._registration
        matrix = registration.align_points_to_map(
            points=_planar_cloud(points),
            voxel_map=self._local_map,
            initial_guess=se2.to_matrix4(guess),
            max_correspondance_distance=3.0 * self._settings.threshold_m,
            kernel=self._settings.threshold_m,
        )
        pose = se2.from_matrix4(matrix)
        correction = se2.between(guess, pose)
        distance_m = float(np.hypot(correction[0], correction[1]))
        too_far = distance_m > self._settings.max_correction_m
        if not np.isfinite(pose).all() or too_far or abs(correction[2]) > self._settings.max_correction_rad:
            reason = f"match is off the guess by {distance_m:.2f} m, {np.degrees(correction[2]):.0f} deg"
            return ScanMatch(guess, correction, accepted=False, reason=reason)
        return ScanMatch(pose, correction, accepted=True)

    def learn(self, points: FloatArray, pose: FloatArray) -> None:
        """Add body-frame points (N, 2) seen at pose (3,) to the local map."""
        self._local_map.update(_planar_cloud(points), se2.to_matrix4(pose))


def _planar_cloud(points: FloatArray) -> FloatArray:
    """Return (N, 3) with z = 0: kiss-icp then keeps z, roll and pitch exactly 0."""
    return np.column_stack([points, np.zeros(len(points))])
