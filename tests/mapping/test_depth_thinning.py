from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.messages import DepthImage, Pinhole
from mapping.depth_projection import CameraMount, pixel_rays
from mapping.depth_thinning import Thinning, decimated, decimated_camera, hangs_between, thinned

SLOPE = 1.0 / (212.5 * np.tan(np.radians(6.0)))  # 4.5 % of the depth from pixel to pixel


@given(arrays(np.uint16, (6, 9), elements=st.sampled_from([0, 0, 500, 1000, 1001, 2000, 65534])), st.integers(1, 4))
def test_each_block_gives_the_lower_median_of_what_was_measured(depth, factor):
    small = decimated(depth, factor)
    assert small.shape == (6 // factor, 9 // factor)
    for row in range(small.shape[0]):
        for col in range(small.shape[1]):
            block = depth[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor].ravel()
            measured = sorted(block[block > 0].tolist())
            assert small[row, col] == (measured[(len(measured) - 1) // 2] if measured else 0)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_decimated_camera_looks_along_the_middle_of_each_block(factor):
    camera, mount = Pinhole(13, 9, 10.0, 11.0, 6.2, 3.9), CameraMount()
    rays = pixel_rays(camera, mount)
    small = pixel_rays(decimated_camera(camera, factor), mount)
    blocks = rays[: 9 // factor * factor, : 13 // factor * factor].reshape(9 // factor, factor, 13 // factor, factor, 3)
    np.testing.assert_allclose(small, blocks.mean(axis=(1, 3)), atol=1e-12)


def test_ramp_between_two_walls_is_dropped_and_the_walls_stay():
    row = [1000] * 5 + [1300, 1700] + [2000] * 5
    hanging = hangs_between(np.array([row], np.uint16), SLOPE)[0]
    assert np.flatnonzero(hanging).tolist() == [5, 6]


@pytest.mark.parametrize(
    ("row", "dropped"),
    [
        ([2000, 2000, 1000, 2000, 2000], []),  # a thin pole stands in front of both neighbours
        ([0, 0, 1000, 2000, 2000], []),  # also beside what was not measured
        ([1000, 1000, 1500, 0, 0], [2]),  # a ramp that ends in the shadow beside an edge
        ([0, 0, 1500, 0, 0], [2]),  # a speck
        ([2000, 2000, 3000, 2000, 2000], [2]),  # behind both
        ([0, 0, 0, 0, 0], []),
    ],
)
def test_single_pixels(row, dropped):
    assert np.flatnonzero(hangs_between(np.array([row], np.uint16), SLOPE)[0]).tolist() == dropped


def test_slanted_wall_stays_up_to_the_angle():
    camera = Pinhole(424, 1, 212.5, 212.5, 211.5, 0.0)
    tangents = (np.arange(424) - camera.cx) / camera.fx
    # A wall to the right, parallel to the axis: a line of sight meets it at its own angle to the axis.
    right = tangents > 0.2
    depth = np.where(right, 1000.0 * 0.9 / np.where(right, tangents, 1.0), 0.0).astype(np.uint16)
    hanging = hangs_between(depth[np.newaxis], SLOPE)[0]
    assert not hanging[tangents > 1.3 * np.tan(np.radians(6.0))].any()


def test_thinning_keeps_limits_stamp_and_number():
    camera = Pinhole(8, 4, 10.0, 10.0, 3.5, 1.5)
    depth = np.full((4, 8), 1000, np.uint16)
    depth[:, :2], depth[:, 6:] = 290, 4010
    small = thinned(DepthImage(5, depth, 0.001, camera, sequence=9), Thinning())
    assert (small.stamp_ns, small.sequence, small.camera.width, small.camera.height) == (5, 9, 4, 2)
    assert small.depth.tolist() == [[0, 1000, 1000, 0]] * 2
    wider = thinned(DepthImage(5, depth, 0.001, camera), Thinning(nearest_m=0.2, farthest_m=5.0, edge_rad=0.001))
    assert (wider.depth > 0).all()


@pytest.mark.parametrize("wrong", [{"decimation": 0}, {"nearest_m": 0.0}, {"nearest_m": 5.0}])
def test_impossible_thinning_is_refused(wrong):
    with pytest.raises(ValueError, match=r"decimation|limits"):
        Thinning(**wrong)
