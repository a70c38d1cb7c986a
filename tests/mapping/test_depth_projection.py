from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.messages import DepthImage, Pinhole
from mapping.depth_projection import CameraMount, pixel_rays, project

CAMERA = Pinhole(24, 16, 20.0, 21.0, 11.3, 7.8)
TURNS = st.floats(-1.5, 1.5)
MOUNTS = st.builds(CameraMount, *(st.floats(-1.0, 1.0),) * 3, TURNS, TURNS, TURNS)


def image(depth, unit_m=0.001, camera=CAMERA):
    return DepthImage(7, np.asarray(depth, np.uint16), unit_m, camera)


def one_pixel(row, col, depth):
    pixels = np.zeros((CAMERA.height, CAMERA.width), np.uint16)
    pixels[row, col] = depth
    return image(pixels)


def test_level_camera_sees_what_is_ahead_left_and_above_where_it_is():
    ahead = Pinhole(3, 3, 2.0, 2.0, 1.0, 1.0)
    points = project(image(np.full((3, 3), 2000), camera=ahead), CameraMount(0.1, 0.2, 0.3)).reshape(3, 3, 3)
    np.testing.assert_allclose(points[1, 1], [2.1, 0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(points[1, 0], [2.1, 1.2, 0.3], atol=1e-12)  # the left column is at the left: y > 0
    np.testing.assert_allclose(points[0, 1], [2.1, 0.2, 1.3], atol=1e-12)  # the upper row is above


@pytest.mark.parametrize(
    ("mount", "seen"),
    [
        (CameraMount(z_m=1.0, pitch_rad=math.pi / 2), [0.0, 0.0, -1.0]),  # looks down
        (CameraMount(z_m=1.0, yaw_rad=math.pi / 2), [0.0, 2.0, 1.0]),  # looks to the left
        (CameraMount(z_m=1.0, yaw_rad=math.pi / 2, pitch_rad=math.pi / 2), [0.0, 0.0, -1.0]),
    ],
)
def test_positive_pitch_looks_down_and_positive_yaw_to_the_left(mount, seen):
    middle = Pinhole(1, 1, 1.0, 1.0, 0.0, 0.0)
    np.testing.assert_allclose(project(image([[2000]], camera=middle), mount)[0], seen, atol=1e-12)


def test_positive_roll_lowers_the_right_side():
    right = Pinhole(2, 1, 1.0, 1.0, 0.0, 0.0)
    points = project(image([[1000, 1000]], camera=right), CameraMount(z_m=0.0, roll_rad=0.1))
    assert points[1, 2] < points[0, 2] == pytest.approx(0.0)


@given(MOUNTS, st.integers(0, 15), st.integers(0, 23), st.integers(1, 65535))
def test_projection_back_into_the_image_gives_the_pixel_and_its_depth(mount, row, col, depth):
    point = project(one_pixel(row, col, depth), mount)
    optical = np.linalg.inv(mount.T_base_optical) @ [*point[0], 1.0]
    assert optical[2] == pytest.approx(depth * 0.001, rel=1e-9, abs=1e-9)
    assert CAMERA.fx * optical[0] / optical[2] + CAMERA.cx == pytest.approx(col, abs=1e-6 + 1e-8 / optical[2])
    assert CAMERA.fy * optical[1] / optical[2] + CAMERA.cy == pytest.approx(row, abs=1e-6 + 1e-8 / optical[2])


@given(MOUNTS)
def test_mount_is_recovered_from_its_matrix(mount):
    found = CameraMount.from_matrix4(mount.T_base_optical)
    np.testing.assert_allclose(found.T_base_optical, mount.T_base_optical, atol=1e-12)
    assert found.pitch_rad == pytest.approx(mount.pitch_rad, abs=1e-9)
    assert np.linalg.det(mount.T_base_optical) == pytest.approx(1.0)


def test_nothing_measured_is_no_point_and_the_unit_counts():
    assert project(image(np.zeros((16, 24))), CameraMount()).shape == (0, 3)
    coarse, fine = one_pixel(3, 4, 100), one_pixel(3, 4, 1000)
    coarse = image(coarse.depth, unit_m=0.01)
    np.testing.assert_allclose(project(coarse, CameraMount()), project(fine, CameraMount()), rtol=1e-12)


def test_rays_are_for_a_depth_of_one():
    mount = CameraMount(0.3, -0.1, 0.2, 0.1, 0.2, -0.3)
    rays = pixel_rays(CAMERA, mount)
    axis = mount.T_base_optical[:3, 2]
    np.testing.assert_allclose(rays @ axis, 1.0, atol=1e-12)
