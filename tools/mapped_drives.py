"""Simulated drives through the product's own flow: what a car with a lidar, or with a depth camera and wheels, maps."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.d435_emulated_firmware import emulated_pinhole
from drivers.messages import DepthImage, LaserScan, Odometry
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.depth_flow import DepthFlow, scan_mount
from tools.depth_noise import DepthNoise
from tools.depth_simulator import SimulatedDepthCamera
from tools.pipeline import MappingFlow
from tools.simulated_wheels import WheelNoise, wheel_odometry
from tools.simulator import SimulatedLidar
from tools.solid_world import SolidWorld

FloatArray = NDArray[np.float64]

_SAMPLES, _LIDAR_HZ, _LIDAR_RANGE_M = 400, 10.0, 12.0  # an RPLIDAR A2 in its standard mode


@dataclass(frozen=True, slots=True)
class CameraSetup:
    """A simulated camera: image size and rate, how it differs from what mapping believes of it, and the car's wheels.

    range_bias: depths are too large by this share. pitch_error_rad: it looks down by so much more than its mount says;
    sway_rad: standard deviation of each image's own roll and pitch. Holes, smeared edges and errors in disparity come
    on top, see DepthNoise. wheels: None for a car without wheel odometry.
    """

    range_bias: float = 0.02
    pitch_error_rad: float = math.radians(1.0)
    sway_rad: float = math.radians(0.3)
    size: tuple[int, int] = (848, 480)
    hz: float = 6.0
    wheels: WheelNoise | None = WheelNoise()


@dataclass(frozen=True, slots=True, eq=False)
class MappedDrive:
    """A drive's map, what mapping believes of the drive, and the truth."""

    flow: MappingFlow
    grid: OccupancyGrid
    truth: Trajectory

    @property
    def trajectory(self) -> Trajectory:
        """The poses of base_link in the map."""
        return self.flow.mapper.trajectory

    @property
    def T_world_map(self) -> FloatArray:  # noqa: N802 - the name says which frames
        """The true pose (3,) of the map frame: where base_link was at the first mapped scan."""
        estimate = self.trajectory
        return se2.compose(self.truth.at(estimate.stamps_ns[:1])[0], se2.inverse(estimate.poses[0]))

    @property
    def T_world_drive(self) -> FloatArray:  # noqa: N802
        """The pose (3,) of the map frame that fits the whole drive best."""
        return np.array(absolute_trajectory_error(self.trajectory, self.truth).T_truth_estimate)

    @property
    def rms_m(self) -> float:
        """The error of the trajectory, fitted to the truth as a whole."""
        return absolute_trajectory_error(self.trajectory, self.truth).rms_m


def map_by_lidar(world: SolidWorld, truth: Trajectory, config: Config, seed: int) -> MappedDrive:
    """Map a drive with an emulated RPLIDAR's ranges, 10 turns a second, by the flow of `run` and `replay`."""
    flow = MappingFlow(config, config.mount())
    for scan in lidar_scans(world, truth, config, seed):
        flow.feed(scan)
    return _finished(flow, truth)


def map_by_camera(world: SolidWorld, truth: Trajectory, config: Config, setup: CameraSetup, seed: int) -> MappedDrive:
    """Map a drive with a simulated D435 and no lidar, by the flow of `run --depth` and `replay`."""
    mount = config.camera_mount()
    depth = DepthFlow(config, lambda _: mount, alone=True)
    flow = MappingFlow(config, scan_mount(mount), depth=depth)
    for message in camera_messages(world, truth, config, setup, seed):
        flow.feed(message)
    return _finished(flow, truth)


def camera_messages(
    world: SolidWorld, truth: Trajectory, config: Config, setup: CameraSetup, seed: int
) -> Iterator[DepthImage | Odometry]:
    """Yield what a recording of the drive holds: images, and wheel odometry where the car has it, by their stamps."""
    camera = SimulatedDepthCamera(
        world,
        truth,
        config.camera_mount(),
        camera=emulated_pinhole(setup.size),
        noise=DepthNoise(range_bias=setup.range_bias),
        pitch_error_rad=setup.pitch_error_rad,
        sway_rad=setup.sway_rad,
        seed=seed,
    )
    stamps = np.arange(int(truth.stamps_ns[0]), int(truth.stamps_ns[-1]), round(1e9 / setup.hz), dtype=np.int64)
    images = (camera.frame(stamp, number) for number, stamp in enumerate(stamps.tolist()))
    wheels: Iterable[DepthImage | Odometry] = () if setup.wheels is None else wheel_odometry(truth, setup.wheels, seed)
    yield from heapq.merge(wheels, images, key=lambda message: message.stamp_ns)


def lidar_scans(world: SolidWorld, truth: Trajectory, config: Config, seed: int) -> Iterator[LaserScan]:
    """Yield the turns of an emulated RPLIDAR along a drive, 10 a second."""
    laser = SimulatedLidar(
        world.cut(config.lidar.mount.z_m),
        truth,
        config.mount(),
        start_delay_s=0.0,
        max_range_m=_LIDAR_RANGE_M,
        seed=seed,
    )
    offsets_s = np.arange(_SAMPLES) / (_SAMPLES * _LIDAR_HZ)
    clockwise = 2.0 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    turns = int(float(truth.stamps_ns[-1]) * 1e-9 * _LIDAR_HZ)
    for turn in range(turns):
        stamp_ns = round(turn * 1e9 / _LIDAR_HZ)
        ranges = laser(stamp_ns + np.rint(offsets_s * 1e9).astype(np.int64), clockwise)
        yield LaserScan(stamp_ns, -clockwise, ranges, offsets_s, 0.15, _LIDAR_RANGE_M)


def _finished(flow: MappingFlow, truth: Trajectory) -> MappedDrive:
    flow.finish()
    flow.refine()
    return MappedDrive(flow, flow.maps()["map"], truth)
