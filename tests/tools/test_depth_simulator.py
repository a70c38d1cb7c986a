"""The rendered depth against plane geometry, and a camera's map against the plan that it was rendered from."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import Pinhole
from mapping.depth_grid import DepthGridBuilder
from mapping.depth_projection import CameraMount, pixel_rays
from mapping.depth_sensor_model import DepthModel
from mapping.trajectory import Trajectory
from mapping.virtual_scan import ScanSettings, scan_depth
from tools.depth_noise import NO_NOISE, DepthNoise
from tools.depth_simulator import D435, SimulatedDepthCamera, render_depth
from tools.simulator import drive_along
from tools.solid_world import ROOM_HEIGHT_M, SolidWorld, solid
from tools.world import OFFICE_TOUR, office

CAMERA = Pinhole(106, 60, 53.0, 53.0, 52.5, 29.5)
CELL_M = 0.01
BOX = (2.0, -0.5, 2.6, 0.4, 0.6)  # x0, y0, x1, y1, height


def room(box=BOX):
    """Walls at x = +-4 and y = +-3 m, and a box."""
    heights = np.full((640, 840), ROOM_HEIGHT_M, np.float32)
    heights[20:-20, 20:-20] = 0.0
    x0, y0, x1, y1, height = box
    heights[
        round((y0 + 3.2) / CELL_M) : round((y1 + 3.2) / CELL_M), round((x0 + 4.2) / CELL_M) : round((x1 + 4.2) / CELL_M)
    ] = height
    return SolidWorld(heights, np.zeros_like(heights), CELL_M, np.array([-4.2, -3.2, 0.0]))


def expected(rays, place, box=BOX):
    """Depth by the planes of room and box, one after the other, for rays (rows, cols, 3) from a place (3,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 3.0, ROOM_HEIGHT_M])
        depth = np.where(rays > 0, (high - place) / rays, (low - place) / rays).min(axis=-1)
        corners = (np.array([box[0], box[1], 0.0]) - place) / rays, (np.array([box[2], box[3], box[4]]) - place) / rays
        enter, leave = np.minimum(*corners).max(axis=-1), np.maximum(*corners).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), np.minimum(enter, depth), depth)


@pytest.mark.parametrize(
    "mount",
    [
        CameraMount(z_m=0.2),
        CameraMount(0.1, -0.05, 1.1, pitch_rad=0.2),  # sees the top of the box
        CameraMount(z_m=0.3, roll_rad=0.05, pitch_rad=-0.1, yaw_rad=0.4),
    ],
)
def test_rendered_depth_is_that_of_the_planes(mount):
    depth = render_depth(room(), np.array([-0.5, 0.2, 0.05]), CAMERA, mount)
    rays = pixel_rays(CAMERA, mount)
    cos, sin = np.cos(0.05), np.sin(0.05)
    turned = np.stack(
        [cos * rays[..., 0] - sin * rays[..., 1], sin * rays[..., 0] + cos * rays[..., 1], rays[..., 2]], -1
    )
    place = np.array([-0.5 + cos * mount.x_m - sin * mount.y_m, 0.2 + sin * mount.x_m + cos * mount.y_m, mount.z_m])
    off = np.abs(depth - expected(turned, place))
    # Surfaces lie up to a cell and a quarter of a column beside; where edges do, whole pixels differ.
    assert np.quantile(off, 0.98) < 0.03
    assert np.median(off) < 0.005


def test_floor_and_ceiling_where_no_wall_is():
    depth = render_depth(room(), np.array([-3.5, 0.0, 0.0]), CAMERA, CameraMount(z_m=0.2))
    rays = pixel_rays(CAMERA, CameraMount())
    assert depth[-1, 10] == pytest.approx(0.2 / -rays[-1, 10, 2], rel=1e-5)
    assert depth[0, 52] == pytest.approx(2.3 / rays[0, 52, 2], rel=1e-5)


def test_camera_that_looks_down_on_itself_is_refused():
    with pytest.raises(ValueError, match="look ahead"):
        render_depth(room(), np.zeros(3), CAMERA, CameraMount(pitch_rad=1.5))


def test_under_a_table_one_sees_its_underside_and_what_is_behind():
    """A top from 0.6 to 0.7 m, x from 2.0 to 2.6: rays above, into and under it end where the planes are."""
    table, place = room((2.0, -0.5, 2.6, 0.4, 0.7)), CameraMount(z_m=0.2)
    table.bottoms_m[table.heights_m == np.float32(0.7)] = 0.6
    depth = render_depth(table, np.zeros(3), CAMERA, place)
    rise = pixel_rays(CAMERA, place)[:, 52, 2]
    at_front, at_back = 0.2 + 2.0 * rise, 0.2 + 2.6 * rise
    behind = np.where(rise < 0.0, np.minimum(4.0, 0.2 / np.maximum(-rise, 1e-9)), 4.0)
    behind = np.minimum(behind, np.where(rise > 0.0, 2.3 / np.maximum(rise, 1e-9), 4.0))
    expected = np.where((at_front >= 0.6) & (at_front < 0.7), 2.0, behind)
    underside = (at_front < 0.6) & (at_back > 0.6)
    expected[underside] = 0.4 / rise[underside]
    assert underside.any()
    assert (expected == 2.0).any()
    clear = np.abs(at_front[:, None] - [0.6, 0.7]).min(axis=1) > 0.02  # rows away from the table's edges
    clear &= np.abs(at_back - 0.6) > 0.02
    np.testing.assert_allclose(depth[clear, 52], expected[clear], atol=0.02)


STILL = Trajectory(np.zeros(1, np.int64), np.zeros((1, 3)))


def test_frames_repeat_with_seed_and_number():
    frames = [
        SimulatedDepthCamera(room(), STILL, CameraMount(), camera=CAMERA, seed=seed).frame(0, number)
        for seed, number in ((1, 5), (1, 5), (1, 6), (2, 5))
    ]
    assert np.array_equal(frames[0].depth, frames[1].depth)
    assert not np.array_equal(frames[0].depth, frames[2].depth)
    assert not np.array_equal(frames[0].depth, frames[3].depth)
    assert (frames[2].sequence, frames[2].stamp_ns) == (6, 0)


def test_pitch_error_tilts_the_camera_down():
    camera = SimulatedDepthCamera(
        room(), STILL, CameraMount(z_m=0.2), camera=CAMERA, noise=NO_NOISE, pitch_error_rad=0.1
    )
    tilted = render_depth(room(), np.zeros(3), CAMERA, CameraMount(z_m=0.2, pitch_rad=0.1))
    np.testing.assert_allclose(camera.frame(0, 0).depth[30, 20:] * 0.001, tilted[30, 20:], atol=0.06)


def test_sway_tilts_each_frame_differently():
    camera = SimulatedDepthCamera(
        room(), STILL, CameraMount(z_m=0.2), camera=CAMERA, noise=NO_NOISE, sway_rad=np.radians(1.0)
    )
    floor = np.array([camera.frame(0, number).depth[-1, 60] * 0.001 for number in range(12)])
    level = 0.2 / (29.5 / 53.0)
    assert len(np.unique(floor)) > 6
    assert 0.4 < np.degrees(np.arctan(0.2 / floor)).std() < 1.8
    np.testing.assert_allclose(floor, level, rtol=0.15)


@pytest.mark.parametrize("worst", [False, True])
def test_map_of_a_drive_shows_the_walls_where_they_are_and_the_way_free(worst):
    """Of the office, with 2 % of range bias and 1 deg of pitch error and some sway where `worst`."""
    walls, drive, mount = office(), drive_along(OFFICE_TOUR), CameraMount(z_m=0.2)
    camera = SimulatedDepthCamera(
        solid(walls),
        drive,
        mount,
        noise=DepthNoise(range_bias=0.02 * worst),
        pitch_error_rad=np.radians(1.0) * worst,
        sway_rad=np.radians(0.3) * worst,
    )
    builder, settings = DepthGridBuilder(0.05, DepthModel()), ScanSettings()
    for number, stamp in enumerate(range(0, 24_000_000_000, 500_000_000)):
        scan = scan_depth(camera.frame(stamp, number), mount, settings)
        builder.add_scan(drive.at(np.array([stamp]))[0], scan)
    grid = builder.grid()

    def share_of_wall_near(cells, reach_m):
        reach = round(reach_m / walls.resolution_m)
        near = np.lib.stride_tricks.sliding_window_view(np.pad(walls.occupied, reach), (2 * reach + 1,) * 2)
        index = np.floor((grid.cell_centers(*np.nonzero(cells)) - walls.origin[:2]) / walls.resolution_m).astype(int)
        return near[index[:, 1], index[:, 0]].any(axis=(1, 2)).mean()

    assert np.count_nonzero(grid.occupied) > 300
    assert share_of_wall_near(grid.occupied, 0.10) > 0.95
    assert share_of_wall_near(grid.free, 0.0) < 0.005
    # A cell is free after five frames, two a second here: not so near the start.
    cells = np.floor(grid.cell_coordinates(drive.poses[60:400, :2])).astype(int)
    assert not grid.occupied[cells[:, 1], cells[:, 0]].any()
    assert grid.free[cells[:, 1], cells[:, 0]].mean() > 0.95


def test_default_camera_is_the_d435_at_its_best_mode():
    half_width = np.degrees(np.arctan(D435.width / 2 / D435.fx))
    assert (D435.width, D435.height) == (848, 480)
    assert 2 * half_width == pytest.approx(89.9, abs=0.2)
