from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole
from mapping.cloud_odometry import CloudOdometry, CloudSettings, part_of
from mapping.depth_projection import CameraMount, pixel_rays

CAMERA = Pinhole(424, 240, 210.0, 210.0, 211.5, 119.5)
LOW, HIGH = np.array([-1.0, -1.5, -0.6]), np.array([2.5, 1.6, 1.4])  # a room,
BALLS = np.random.default_rng(5).uniform([1.2, -1.5, -0.6], [2.5, 1.5, 1.4], (25, 3))  # with things in it,
RADIUS_M = 0.25
T_BODY_OPTICAL = CameraMount(z_m=0.0).T_base_optical


def moved(x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0):
    """The pose (4, 4) of a camera's body in the room."""
    return CameraMount(x, y, z, roll, pitch, yaw).T_base_optical @ np.linalg.inv(T_BODY_OPTICAL)


def seen_from(pose, stamp_ns):
    """The room with the balls in it, exactly."""
    rays, start = pixel_rays(CAMERA, CameraMount.from_matrix4(pose @ T_BODY_OPTICAL)), pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.where(rays > 0, (HIGH - start) / rays, (LOW - start) / rays).min(axis=2)
    squared = (rays**2).sum(axis=2)
    for centre in BALLS - start:  # |depth ray - centre| = radius
        along = rays @ centre
        root = along**2 - squared * (centre @ centre - RADIUS_M**2)
        hits = root > 0.0
        depth_m[hits] = np.minimum(depth_m[hits], ((along[hits] - np.sqrt(root[hits])) / squared[hits]))
    return DepthImage(stamp_ns, np.rint(depth_m * 1000.0).astype(np.uint16), 0.001, CAMERA)


def located(odometry, image):
    pose = odometry.add(image)
    assert pose is not None
    return pose


def angle_between(first, second):
    return np.arccos(np.clip((np.trace(first[:3, :3].T @ second[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))


def test_a_motion_in_six_degrees_of_freedom_is_recovered():
    way = [moved(0.02 * n, -0.01 * n, 0.005 * n, roll=0.004 * n, pitch=0.006 * n, yaw=-0.01 * n) for n in range(20)]
    odometry = CloudOdometry(CloudSettings())
    found = [located(odometry, seen_from(pose, 33_000_000 * n)) for n, pose in enumerate(way)]
    assert np.array_equal(found[0], np.eye(4))
    for estimate, pose in zip(found, way, strict=True):
        assert np.linalg.norm(estimate[:3, 3] - pose[:3, 3]) < 0.05
        assert angle_between(estimate, pose) < 0.04
    assert np.linalg.norm(way[-1][:3, 3]) > 0.4
    assert angle_between(way[-1], np.eye(4)) > 0.2


@pytest.mark.parametrize(("gap", "x"), [(3, 0.26), (100, 0.20)])
def test_after_a_short_gap_the_motion_is_taken_to_go_on_and_after_a_long_one_to_have_ended(gap, x):
    odometry = CloudOdometry(CloudSettings())
    for number in range(11):
        located(odometry, seen_from(moved(0.02 * number), 33_000_000 * number))
    found = located(odometry, seen_from(moved(x), 33_000_000 * (10 + gap)))
    assert found[:3, 3] == pytest.approx([x, 0.0, 0.0], abs=0.06)


def test_an_image_with_nothing_in_it_has_no_pose_and_changes_nothing():
    sound, disturbed = CloudOdometry(CloudSettings()), CloudOdometry(CloudSettings())
    empty = DepthImage(40_000_000, np.zeros((240, 424), np.uint16), 0.001, CAMERA)
    poses = []
    for odometry in (sound, disturbed):
        for number in range(3):
            pose = located(odometry, seen_from(moved(0.02 * number), 33_000_000 * number))
            if odometry is disturbed and number == 1:
                assert odometry.add(empty) is None
        poses.append(pose)
    assert np.array_equal(poses[0], poses[1])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0, 2.0])
def test_parts_of_a_motion_are_of_one_turn_about_one_axis(share):
    whole = moved(0.1, 0.2, -0.3, roll=0.2, pitch=-0.3, yaw=0.5)
    part = part_of(whole, share)
    assert part[:3, 3] == pytest.approx(share * whole[:3, 3])
    assert part[:3, :3] @ part[:3, :3].T == pytest.approx(np.eye(3))
    assert angle_between(part, np.eye(4)) == pytest.approx(share * angle_between(whole, np.eye(4)), abs=1e-7)
    both = part_of(whole, share)[:3, :3] @ part_of(whole, 1.0 - share)[:3, :3]
    assert both == pytest.approx(whole[:3, :3])
