"""Seen by a level camera, 0.2 m above the floor, between planes whose place is known."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole
from mapping.depth_projection import CameraMount, pixel_rays
from mapping.virtual_scan import ScanSettings, StereoNoise, VirtualScan, scan_depth

CAMERA = Pinhole(212, 120, 106.0, 106.0, 105.5, 59.5)
MOUNT = CameraMount(x_m=0.1, y_m=0.05, z_m=0.2)
SETTINGS = ScanSettings(pixels_per_beam=4, support=4)


def seen(wall_m=2.0, *, mount=MOUNT, floor=True, box=None, camera=CAMERA):
    """The image of a wall at x = wall_m + mount.x, the floor, and a box: a face at x, from y0 to y1, to a height."""
    rays = pixel_rays(camera, mount)
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 0] > 0, wall_m / rays[..., 0], np.inf)
        down = np.where(rays[..., 2] < 0, -mount.z_m / rays[..., 2], np.inf)
    hidden = down < depth
    depth = np.where(hidden, down if floor else 0.0, depth)
    if box is not None:
        x, y0, y1, top = box
        z = (x - mount.x_m) / rays[..., 0]
        y, height = mount.y_m + z * rays[..., 1], mount.z_m + z * rays[..., 2]
        on_face = (y > y0) & (y < y1) & (height > 0) & (height < top)
        depth = np.where(on_face, z, depth)
    return DepthImage(3, np.where(depth < 60.0, depth * 1000.0, 0.0).round().astype(np.uint16), 0.001, camera)


def blanked(image, where):
    depth = image.depth.copy()
    depth[where] = 0
    return DepthImage(image.stamp_ns, depth, image.unit_m, image.camera)


def test_wall_across_is_met_by_each_beam_at_its_angle():
    scan = scan_depth(seen(2.0), MOUNT, SETTINGS)
    assert len(scan.angles_rad) == 53
    assert (np.diff(scan.angles_rad) > 0.0).all()
    np.testing.assert_allclose(scan.ranges_m * np.cos(scan.angles_rad), 2.0, atol=0.02)
    np.testing.assert_array_equal(scan.free_to_m, scan.ranges_m)
    assert scan.angles_rad[[0, -1]] == pytest.approx(np.arctan([-104 / 106.0, 104 / 106.0]))


def test_beams_turn_and_move_with_the_camera():
    mount = CameraMount(x_m=-0.3, y_m=0.4, z_m=0.2, yaw_rad=0.3)
    scan = scan_depth(seen(2.0, mount=mount), mount, SETTINGS)
    ends = scan.origin + scan.ranges_m[:, np.newaxis] * np.column_stack(
        [np.cos(scan.angles_rad), np.sin(scan.angles_rad)]
    )
    np.testing.assert_allclose(ends[scan.ranges_m > 0, 0], 1.7, atol=0.03)
    assert np.abs(scan.angles_rad).max() > np.pi / 4


@pytest.mark.parametrize("pitch_deg", [-8.0, 0.0, 8.0])
def test_pitch_that_is_known_changes_nothing(pitch_deg):
    mount = CameraMount(z_m=0.2, pitch_rad=np.radians(pitch_deg))
    scan = scan_depth(seen(2.0, mount=mount), mount, SETTINGS)
    met = scan.ranges_m > 0
    assert met[5:-5].all()
    np.testing.assert_allclose((scan.ranges_m * np.cos(scan.angles_rad))[met], 2.0, atol=0.03)


def test_pitch_that_is_not_known_makes_no_obstacle_of_the_floor():
    for error in np.radians([-1.0, 1.0]):
        actual = CameraMount(z_m=0.2, pitch_rad=error)
        scan = scan_depth(seen(20.0, mount=actual), CameraMount(z_m=0.2), SETTINGS)
        assert not scan.ranges_m.any()


def test_low_box_stands_before_the_wall():
    scan = scan_depth(seen(3.0, box=(1.6, -0.2, 0.3, 0.5)), MOUNT, SETTINGS)
    y_at_box = MOUNT.y_m + 1.5 * np.tan(scan.angles_rad)
    before, beside = (y_at_box > -0.15) & (y_at_box < 0.25), (y_at_box < -0.25) | (y_at_box > 0.35)
    np.testing.assert_allclose((scan.ranges_m * np.cos(scan.angles_rad))[before], 1.5, atol=0.02)
    np.testing.assert_allclose((scan.ranges_m * np.cos(scan.angles_rad))[beside], 3.0, atol=0.03)


def test_table_top_is_an_obstacle_and_what_hangs_high_is_none():
    low, high = (seen(3.0, box=(1.6, -9, 9, top)) for top in (9.0, 9.0))
    rows = pixel_rays(CAMERA, MOUNT)[:, 0, 2] * 1.5 + MOUNT.z_m
    low, high = blanked(low, rows < 0.7), blanked(high, rows < 1.25)
    np.testing.assert_allclose((s := scan_depth(low, MOUNT, SETTINGS)).ranges_m * np.cos(s.angles_rad), 1.5, atol=0.02)
    assert not scan_depth(high, MOUNT, SETTINGS).ranges_m.any()


def test_floor_without_obstacle_is_free_as_far_as_it_is_seen():
    scan = scan_depth(seen(40.0), MOUNT, SETTINGS)  # the wall is out of reach
    assert not scan.ranges_m.any()
    assert (scan.free_to_m > 3.0).all()
    near = blanked(seen(40.0), pixel_rays(CAMERA, MOUNT)[..., 2] > -0.2 / 1.5)  # floor up to 1.5 m ahead only
    scan = scan_depth(near, MOUNT, SETTINGS)
    ahead = scan.free_to_m * np.cos(scan.angles_rad)
    assert (ahead > 1.1).all()
    assert (ahead < 1.6).all()


def test_direction_without_any_pixel_is_unknown():
    scan = scan_depth(blanked(seen(2.0), np.s_[:, :40]), MOUNT, SETTINGS)
    np.testing.assert_array_equal(scan.ranges_m[-10:], 0.0)  # the left of the image is the left of the car
    np.testing.assert_array_equal(scan.free_to_m[-10:], 0.0)
    assert (scan.free_to_m[:-10] > 0.0).all()


def test_nothing_is_free_behind_something_that_cannot_be_measured():
    """A black box at 1 m, 0.3 m high: no depth, but the wall is seen above it."""
    box = (1.1, -0.3, 0.4, 0.3)
    image = seen(3.0, box=box)
    black = blanked(image, np.abs(image.depth.astype(int) - 1000) < 3)
    scan = scan_depth(black, MOUNT, SETTINGS)
    y_at_box = MOUNT.y_m + np.tan(scan.angles_rad)
    behind = (y_at_box > -0.25) & (y_at_box < 0.35)
    np.testing.assert_allclose(scan.ranges_m[behind] * np.cos(scan.angles_rad[behind]), 3.0, atol=0.03)
    assert (scan.free_to_m[behind] < 1.2).all()
    assert (scan.free_to_m[~behind][:10] > 2.0).all()


@pytest.mark.parametrize(("height_m", "pitch_deg"), [(0.2, 0.0), (1.3, 30.0), (1.3, 60.0), (0.3, -10.0)])
def test_nothing_is_known_nearer_than_the_image_reaches_down(height_m, pitch_deg):
    mount = CameraMount(z_m=height_m, pitch_rad=np.radians(pitch_deg))
    scan = scan_depth(seen(5.0, mount=mount), mount, SETTINGS)
    ray = pixel_rays(CAMERA, mount)[-1, 105]  # the middle of the last row
    assert scan.free_from_m[26] == pytest.approx(max(0.3, (height_m - 0.1) * ray[0] / -ray[2]), rel=0.01)


def test_left_margin_knows_nothing_of_what_only_the_left_imager_sees():
    """A point at depth z and column u lies at u - fB / z in the right image: outside where z < fB / u."""
    scan = scan_depth(seen(3.0), MOUNT, SETTINGS)
    depth = scan.free_from_m * np.cos(scan.angles_rad)
    columns = (CAMERA.cx - CAMERA.fx * np.tan(scan.angles_rad) - 1.5).round()  # the beams' first columns
    np.testing.assert_allclose(depth[-4:-1], CAMERA.fx * 0.05 / columns[-4:-1], rtol=1e-6)
    assert depth[-1] > 4.0
    assert (scan.free_from_m[:30] < 0.4).all()


def test_camera_that_looks_up_clears_nothing():
    mount = CameraMount(z_m=0.3, pitch_rad=np.radians(-40.0))
    scan = scan_depth(seen(1.0, mount=mount), mount, SETTINGS)
    assert np.isinf(scan.free_from_m).all()
    assert (scan.ranges_m > 0.0).any()


def test_wall_without_visible_floor_is_free_up_to_the_wall():
    scan = scan_depth(seen(2.0, floor=False), MOUNT, SETTINGS)
    np.testing.assert_array_equal(scan.free_to_m, scan.ranges_m)


def test_scattered_wrong_pixels_are_no_obstacles():
    image = seen(3.0)
    depth = image.depth.copy()
    random = np.random.default_rng(1)
    wrong = random.random(depth.shape) < 0.02
    depth[wrong] = random.integers(400, 2500, np.count_nonzero(wrong))
    scan = scan_depth(DepthImage(0, depth, 0.001, CAMERA), MOUNT, SETTINGS)
    np.testing.assert_allclose(scan.ranges_m * np.cos(scan.angles_rad), 3.0, atol=0.05)


def test_sigma_grows_with_the_square_of_the_range():
    noise = StereoNoise(bias=0.0)
    assert noise.sigma_m(np.array([2.0]), 425.0)[0] == pytest.approx(4 * noise.sigma_m(np.array([1.0]), 425.0)[0])
    assert noise.sigma_m(np.array([1.0]), 425.0)[0] == pytest.approx(0.08 / (425.0 * 0.05))
    assert StereoNoise(disparity_px=0.0, bias=0.02).sigma_m(np.array([3.0]), 425.0)[0] == pytest.approx(0.06)
    scans = [scan_depth(seen(wall), MOUNT, SETTINGS) for wall in (1.0, 2.0)]
    assert (scans[1].sigma_m > scans[0].sigma_m).all()


def test_laser_scan_has_the_same_points():
    scan = scan_depth(seen(2.0), MOUNT, SETTINGS)
    laser = scan.to_laser_scan()
    points = scan.mount.to_body(laser.angles_rad, laser.ranges_m)[laser.valid]
    np.testing.assert_allclose(points[:, 0], 2.1, atol=0.02)
    assert laser.stamp_ns == 3
    assert not scan.to_laser_scan(range_max_m=1.5).valid.any()


def test_impossible_settings_and_scans_are_refused():
    with pytest.raises(ValueError, match="order"):
        ScanSettings(bottom_m=1.3)
    with pytest.raises(ValueError, match="support"):
        ScanSettings(support=0)
    with pytest.raises(ValueError, match="free_to_m"):
        VirtualScan(0, np.zeros(2), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
    scan = scan_depth(seen(2.0), MOUNT, SETTINGS)
    with pytest.raises(ValueError, match="read-only"):
        scan.ranges_m[0] = 1.0
