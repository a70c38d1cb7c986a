"""A simulated depth camera on a car: the true depth of a world with heights, and the frames that a D435 makes of it.

What is modelled: walls, furniture with tops and undersides, floor and ceiling, any turn of the camera, the noise of
depth_noise. What is not: motion during the exposure, glass and mirrors, people, slanted surfaces, sunlight.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.messages import DepthImage, Pinhole
from mapping import se2
from mapping.depth_projection import CameraMount, pixel_rays
from mapping.trajectory import Trajectory
from tools.depth_noise import DepthNoise, noisy_depth
from tools.solid_world import ROOM_HEIGHT_M, SolidWorld

FloatArray = NDArray[np.float64]
Image = NDArray[np.float32]

D435 = Pinhole(848, 480, 425.0, 425.0, 423.5, 239.5)
UNIT_M = 0.001
_MAX_DEPTH_M = 12.0
_OBSTACLES = 12  # blocks lower than the camera's rays that a vertical plane may cross before the wall behind them


def render_depth(world: SolidWorld, pose: FloatArray, camera: Pinhole, mount: CameraMount) -> Image:
    """Return the true depth (rows, cols) in m seen by a car at pose (3,) in the world; 0 where nothing is near enough.

    A pixel looks along a vertical plane through the camera. The planes are cast once through the plan, two for each
    column of the image; each pixel then finds the first floor, face, top or ceiling in the plane next to it, which for
    a level camera is its own.
    """
    rays = pixel_rays(camera, mount)
    ahead = se2.compose(pose, [mount.x_m, mount.y_m, mount.yaw_rad])
    cos, sin = math.cos(mount.yaw_rad), math.sin(mount.yaw_rad)
    forward, left = rays[..., 0] * cos + rays[..., 1] * sin, rays[..., 1] * cos - rays[..., 0] * sin
    if forward.min() <= 0.0:
        raise ValueError(f"{mount}: the camera must look ahead, less than upright or down at all pixels")
    step = 0.5 / camera.fx
    shift = camera.cx / camera.fx  # so that columns of a level camera fall on planes
    numbers = np.rint((left / forward - shift) / step).astype(np.int32)
    first = int(numbers.min())
    tangents = np.arange(first, int(numbers.max()) + 1) * step + shift
    start = se2.transform_points(se2.inverse(world.origin), ahead[np.newaxis, :2])[0] / world.resolution_m
    headings = ahead[2] - world.origin[2] + np.arctan(tangents)
    reach = _MAX_DEPTH_M * 1.5 / world.resolution_m
    planes = _cast_planes(world.heights_m, world.bottoms_m, start, headings, reach, ROOM_HEIGHT_M)
    planes[..., :2] *= world.resolution_m
    return np.asarray(_look(planes, numbers - first, rays, mount.z_m, ROOM_HEIGHT_M, _MAX_DEPTH_M))


class SimulatedDepthCamera:
    """Frames that a depth camera on a moving car takes in a world.

    truth: the car's drive. mount: where the camera is believed to sit; it looks down by pitch_error_rad more than that.
    sway_rad: standard deviation of the roll and pitch that each frame has besides, since no car stands level always.
    Each frame's noise depends on the seed and the frame's number only.
    """

    def __init__(
        self,
        world: SolidWorld,
        truth: Trajectory,
        mount: CameraMount,
        *,
        camera: Pinhole = D435,
        noise: DepthNoise | None = None,
        pitch_error_rad: float = 0.0,
        sway_rad: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._world = world
        self._truth = truth
        self._mount = replace(mount, pitch_rad=mount.pitch_rad + pitch_error_rad)
        self._camera = camera
        self._noise = noise or DepthNoise()
        self._sway_rad = sway_rad
        self._seed = seed

    def frame(self, stamp_ns: int, sequence: int) -> DepthImage:
        """Return the frame number `sequence`, taken at an instant on the drive's clock."""
        pose = self._truth.at(np.array([stamp_ns], dtype=np.int64))[0]
        random = np.random.default_rng([self._seed, sequence])
        roll, pitch = (random.standard_normal(2) * self._sway_rad).tolist()
        mount = replace(self._mount, roll_rad=self._mount.roll_rad + roll, pitch_rad=self._mount.pitch_rad + pitch)
        true_m = render_depth(self._world, pose, self._camera, mount)
        depth = noisy_depth(true_m, self._camera.fx, self._noise, random, UNIT_M)
        return DepthImage(stamp_ns, depth, UNIT_M, self._camera, sequence=sequence)


@njit(cache=True, nogil=True)
def _cast_planes(
    heights: Image, bottoms: Image, start: FloatArray, headings: FloatArray, reach: float, ceiling: float
) -> FloatArray:
    """Return for each heading the blocks that it crosses, nearest first, up to the first that reaches the ceiling.

    start (2,) and reach in cells; the blocks (headings, _OBSTACLES, 4) are entry and exit in cells, height and bottom
    in m.
    """
    rows, cols = heights.shape
    planes = np.zeros((headings.shape[0], _OBSTACLES, 4))
    for ray in range(headings.shape[0]):
        dx, dy = math.cos(headings[ray]), math.sin(headings[ray])
        col, row = math.floor(start[0]), math.floor(start[1])
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        delta_x = abs(1.0 / dx) if dx != 0.0 else math.inf
        delta_y = abs(1.0 / dy) if dy != 0.0 else math.inf
        next_x = ((col + 1.0 - start[0]) if dx > 0 else (start[0] - col)) * delta_x if dx != 0.0 else math.inf
        next_y = ((row + 1.0 - start[1]) if dy > 0 else (start[1] - row)) * delta_y if dy != 0.0 else math.inf
        travelled, block, standing, hanging = 0.0, -1, 0.0, 0.0
        while travelled < reach and 0 <= row < rows and 0 <= col < cols:
            height, bottom = heights[row, col], bottoms[row, col]
            if height != standing or bottom != hanging:
                if standing > 0.0:
                    planes[ray, block, 1] = travelled
                if height > 0.0:
                    block += 1
                    if block == _OBSTACLES:
                        break
                    planes[ray, block, 0] = travelled
                    planes[ray, block, 1] = math.inf
                    planes[ray, block, 2] = height
                    planes[ray, block, 3] = bottom
                    if height >= ceiling and bottom <= 0.0:
                        break
                standing, hanging = height, bottom
            if next_x < next_y:
                travelled, next_x, col = next_x, next_x + delta_x, col + step_x
            else:
                travelled, next_y, row = next_y, next_y + delta_y, row + step_y
    return planes


@njit(cache=True, nogil=True)
def _look(
    planes: FloatArray,
    numbers: NDArray[np.int32],
    rays: FloatArray,
    camera_height: float,
    ceiling: float,
    max_depth: float,
) -> Image:
    """Return the depth (rows, cols) of the first surface along each pixel's ray (rows, cols, 3), given for depth 1.

    planes: blocks (planes, blocks, 4) as entry and exit in m, height and bottom; numbers (rows, cols): the plane of a
    pixel.
    """
    rows, cols = numbers.shape
    depth = np.zeros((rows, cols), np.float32)
    for row in range(rows):
        for col in range(cols):
            rise = rays[row, col, 2]
            run = math.hypot(rays[row, col, 0], rays[row, col, 1])  # horizontal way for a depth of 1
            nearest = math.inf
            if rise < 0.0:
                nearest = camera_height / -rise
            elif rise > 0.0:
                nearest = (ceiling - camera_height) / rise
            plane = planes[numbers[row, col]]
            for block in range(plane.shape[0]):
                if plane[block, 2] == 0.0 or plane[block, 0] >= nearest * run:
                    break
                entry = plane[block, 0] / run
                at_entry = camera_height + rise * entry
                if plane[block, 3] <= at_entry < plane[block, 2]:
                    nearest = entry
                    break
                side = plane[block, 2] if at_entry >= plane[block, 2] else plane[block, 3]  # top or underside
                if (side - at_entry) * rise > 0.0:
                    face = (side - camera_height) / rise
                    if face * run < plane[block, 1]:
                        nearest = min(nearest, face)
                        break
            if nearest <= max_depth:
                depth[row, col] = nearest
    return depth
