from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.messages import Transform
from mapping import se2
from mapping.errors import MappingError
from mapping.frames import find_mount, find_pose, planar_transform

FloatArray = NDArray[np.float64]

POSES = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.1, 3.1)).map(np.array)


def assert_same_pose(actual: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(actual[:2], expected[:2], atol=1e-12)
    np.testing.assert_allclose(se2.wrap_angle(actual[2] - expected[2]), 0.0, atol=1e-12)


@given(POSES, st.booleans())
def test_mount_of_a_stated_transform_is_its_pose(pose: FloatArray, inverted: bool) -> None:
    mount = find_mount([planar_transform(0, "base_link", "laser", pose, inverted=inverted)], "base_link", "laser")
    assert mount is not None
    assert_same_pose(mount.pose, pose)
    assert mount.inverted == inverted


@given(POSES, POSES, POSES)
def test_transforms_chain_in_any_order_and_direction(
    base_plate: FloatArray, plate_mast: FloatArray, mast_laser: FloatArray
) -> None:
    transforms = [
        planar_transform(0, "mast", "laser", mast_laser),
        planar_transform(0, "mast", "plate", se2.inverse(plate_mast)),  # stated the other way round
        planar_transform(0, "base_link", "plate", base_plate),
        planar_transform(0, "elsewhere", "camera", base_plate),
    ]
    mount = find_mount(transforms, "base_link", "laser")
    assert mount is not None
    assert_same_pose(mount.pose, se2.compose(base_plate, se2.compose(plate_mast, mast_laser)))
    assert not mount.inverted


@given(POSES, st.floats(-3.1, 3.1), st.floats(0.1, 5.0))
def test_an_inverted_laser_sees_points_as_the_rotation_matrix_says(
    pose: FloatArray, angle: float, range_m: float
) -> None:
    mount = find_mount([planar_transform(0, "base_link", "laser", pose, inverted=True)], "base_link", "laser")
    assert mount is not None
    yaw_matrix = se2.to_matrix4(pose)
    point = yaw_matrix @ np.diag([1.0, -1.0, -1.0, 1.0]) @ [range_m * np.cos(angle), range_m * np.sin(angle), 0.0, 1.0]
    np.testing.assert_allclose(mount.to_body(np.array([angle]), np.array([range_m]))[0], point[:2], atol=1e-12)


def test_height_is_kept_in_the_transform_and_dropped_from_the_mount() -> None:
    transform = planar_transform(7, "base_link", "laser", np.array([0.1, 0.2, 0.3, 0.4]))
    np.testing.assert_array_equal(transform.translation, [0.1, 0.2, 0.3])
    assert (transform.stamp_ns, transform.static) == (7, True)
    mount = find_mount([transform], "base_link", "laser")
    assert mount is not None
    assert_same_pose(mount.pose, np.array([0.1, 0.2, 0.4]))


def test_leading_slashes_of_ros_1_are_ignored() -> None:
    mount = find_mount([planar_transform(0, "/base_link", "/laser", np.array([0.1, 0.0, 0.0]))], "base_link", "/laser")
    assert mount is not None


def test_the_base_itself_is_where_it_is() -> None:
    mount = find_mount([], "laser", "laser")
    assert mount is not None
    assert_same_pose(mount.pose, np.zeros(3))


@pytest.mark.parametrize("transforms", [[], [planar_transform(0, "base_link", "camera", np.zeros(3))]])
def test_an_unconnected_laser_has_no_mount(transforms: list[Transform]) -> None:
    assert find_mount(transforms, "base_link", "laser") is None


@pytest.mark.parametrize(("tilt_deg", "accepted"), [(2.0, True), (20.0, False), (90.0, False)])
def test_a_tilted_laser_is_refused(tilt_deg: float, accepted: bool) -> None:
    half = np.radians(tilt_deg) / 2.0
    transform = Transform(0, "base_link", "laser", np.zeros(3), np.array([0.0, np.sin(half), 0.0, np.cos(half)]))
    if accepted:
        assert find_mount([transform], "base_link", "laser") is not None
        return
    with pytest.raises(MappingError, match=f"tilted by {tilt_deg:.0f} deg"):
        find_mount([transform], "base_link", "laser")


def test_a_tilted_sensor_s_whole_pose_is_found_where_its_mount_is_refused():
    half = 0.2
    tilted = Transform(
        0,
        "base_link",
        "camera",
        np.array([0.3, 0.0, 0.2]),
        np.array([0.0, np.sin(half), 0.0, np.cos(half)]),
        static=True,
    )
    found = find_pose([tilted], "/base_link", "camera")
    assert found is not None
    assert found[:3, 3] == pytest.approx([0.3, 0.0, 0.2])
    assert found[:3, 0] == pytest.approx([np.cos(0.4), 0.0, -np.sin(0.4)])
    assert find_pose([tilted], "base_link", "laser") is None
    with pytest.raises(MappingError, match="tilted"):
        find_mount([tilted], "base_link", "camera")
