from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import DepthImage, Odometry
from mapping import se2
from mapping.trajectory import Trajectory
from tools.config import Config
from tools.mapped_drives import CameraSetup, camera_messages, map_by_camera, map_by_lidar
from tools.simulator import drive_along
from tools.solid_world import solid
from tools.world import OFFICE_TOUR, office

SMALL = CameraSetup(size=(424, 240))
CONFIG = Config()


@pytest.fixture(scope="module")
def world():
    return solid(office())


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    whole = drive_along(OFFICE_TOUR)
    return Trajectory(whole.stamps_ns[:180], whole.poses[:180])  # 9 s, 4.5 m


def share_on_walls(mapped, world, z_m, reach_m):
    """Share of the map's occupied cells that have a wall of the world's cut within reach at the true pose."""
    plan = world.cut(z_m)
    reach = round(reach_m / plan.resolution_m)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(plan.occupied, reach), (2 * reach + 1,) * 2)
    near = np.asarray(windows.any(axis=(2, 3)))
    points = se2.transform_points(mapped.T_world_map, mapped.grid.cell_centers(*np.nonzero(mapped.grid.occupied)))
    cells = np.floor((points - plan.origin[:2]) / plan.resolution_m).astype(int)
    return near[cells[:, 1], cells[:, 0]].mean()


def test_a_lidar_maps_the_walls_of_its_plane(world, truth):
    mapped = map_by_lidar(world, truth, CONFIG, 3)
    assert mapped.rms_m < 0.03
    assert np.count_nonzero(mapped.grid.occupied) > 300
    assert share_on_walls(mapped, world, 0.19, 0.1) > 0.97


def test_a_camera_with_wheels_maps_them_too_and_its_frame_is_where_it_started(world, truth):
    mapped = map_by_camera(world, truth, CONFIG, SMALL, 3)
    assert mapped.rms_m < 0.08
    np.testing.assert_allclose(mapped.T_world_map, truth.poses[0], atol=1e-6)
    apart = se2.between(mapped.T_world_map, mapped.T_world_drive)
    assert np.hypot(apart[0], apart[1]) < 0.15
    assert share_on_walls(mapped, world, 0.19, 0.2) > 0.9


def test_messages_come_by_their_stamps_and_repeat(world, truth):
    first, again = (list(camera_messages(world, truth, CONFIG, SMALL, 5)) for _ in range(2))
    stamps = [message.stamp_ns for message in first]
    assert stamps == sorted(stamps)
    assert sum(isinstance(message, Odometry) for message in first) == len(truth)
    images = [message for message in first if isinstance(message, DepthImage)]
    assert len(images) == pytest.approx(6.0 * truth.stamps_ns[-1] * 1e-9, abs=1)
    repeated = [message for message in again if isinstance(message, DepthImage)]
    assert all(np.array_equal(one.depth, other.depth) for one, other in zip(images, repeated, strict=True))


def test_a_car_without_wheels_sends_images_only_and_bias_makes_them_deeper(world, truth):
    short = Trajectory(truth.stamps_ns[:10], truth.poses[:10])
    bare = replace(SMALL, wheels=None, range_bias=0.0, pitch_error_rad=0.0, sway_rad=0.0)
    exact, biased = (
        list(camera_messages(world, short, CONFIG, setup, 5)) for setup in (bare, replace(bare, range_bias=0.02))
    )
    assert all(isinstance(message, DepthImage) for message in exact)
    one, other = exact[0].depth.astype(float), biased[0].depth.astype(float)
    seen = (one > 500) & (one < 3000)
    assert np.median(other[seen] / one[seen]) == pytest.approx(1.02, abs=0.002)
