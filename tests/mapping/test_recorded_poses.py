from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import Transform
from mapping.depth_projection import CameraMount
from mapping.frames import matrix4, planar_transform
from mapping.recorded_poses import RecordedPoses, below, floor_height, levelled

OPTICAL = "camera_depth_optical_frame"
BASES = ("base_link", "base_footprint")


def moving(stamp_ns, parent, child, x, y, yaw):
    half = yaw / 2.0
    quaternion = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
    return Transform(stamp_ns, parent, child, np.array([x, y, 0.0]), quaternion)


def test_the_car_s_pose_is_chained_from_the_root():
    poses = RecordedPoses(BASES, OPTICAL, np.eye(4))
    assert poses.add(planar_transform(0, "base_link", OPTICAL, np.array([0.2, 0.0, 0.1, 0.0]))) is None
    assert poses.add(moving(1, "odom", "base_link", 1.0, 0.0, 0.0)).pose == pytest.approx([1.0, 0.0, 0.0])
    poses.add(moving(2, "map", "odom", 0.0, 2.0, np.pi / 2))
    odometry = poses.add(moving(3, "odom", "base_link", 1.0, 0.0, 0.0))
    assert odometry.pose == pytest.approx([0.0, 3.0, np.pi / 2])
    assert (odometry.stamp_ns, odometry.child_frame_id) == (3, "base_link")
    assert poses.mount is None, "the car's mount is fixed"


def test_other_transforms_say_nothing():
    poses = RecordedPoses(BASES, OPTICAL, np.eye(4))
    assert poses.add(moving(1, "base_link", "wheel", 0.0, 0.0, 0.3)) is None
    assert poses.add(moving(1, "map", "person", 4.0, 0.0, 0.3)) is None
    assert poses.mount is None


def test_a_ring_of_frames_ends():
    poses = RecordedPoses(BASES, OPTICAL, np.eye(4))
    poses.add(moving(1, "base_link", "odom", 0.0, 0.0, 0.0))
    poses.add(moving(1, "odom", "base_link", 0.0, 0.0, 0.0))


@pytest.mark.parametrize("yaw", [-3.0, 0.4, 2.0])
def test_a_camera_held_in_the_hand_is_above_its_place_on_the_floor(yaw):
    mount = CameraMount(0.0, 0.0, 1.3, roll_rad=0.1, pitch_rad=0.4)
    T_map_base = matrix4(moving(0, "", "", 2.0, -1.0, yaw))
    pose, found = below(T_map_base @ mount.T_base_optical)
    assert pose[:2] == pytest.approx([2.0, -1.0])
    T_found = matrix4(moving(0, "", "", *pose)) @ found.T_base_optical
    assert T_found == pytest.approx(T_map_base @ mount.T_base_optical)
    assert (found.x_m, found.y_m, found.yaw_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_levelled_turns_gravity_downwards():
    random = np.random.default_rng(4)
    for gravity in (*random.normal(size=(20, 3)), np.array([0.0, 0.0, -9.8]), np.array([0.0, 9.8, 0.0])):
        turn = levelled(gravity)[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1.0)
        assert turn @ gravity / np.linalg.norm(gravity) == pytest.approx([0.0, 0.0, -1.0])
    assert levelled(np.array([0.0, 1.0, 0.0]))[:3, 2] == pytest.approx([1.0, 0.0, 0.0]), "the camera looks ahead"


def test_the_floor_is_the_lowest_level_with_many_points():
    random = np.random.default_rng(1)
    floor = random.normal(-0.7, 0.01, 4000)
    table = random.normal(0.05, 0.005, 8000)
    stray = random.uniform(-2.0, 1.0, 200)
    assert floor_height(np.concatenate([table, floor, stray])) == pytest.approx(-0.7, abs=0.04)
    assert floor_height(np.zeros(0)) == 0.0
