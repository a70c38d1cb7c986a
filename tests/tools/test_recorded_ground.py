from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.depth_folder import DepthFolder
from drivers.errors import RecordingError
from drivers.messages import Pinhole, Transform
from mapping import se2
from mapping.depth_projection import CameraMount, pixel_rays
from tools.config import Config, parse
from tools.recorded_ground import GRAVITY, recorded_ground

CAMERA = Pinhole(80, 60, 60.0, 60.0, 39.5, 29.5)
MOUNT = CameraMount(0.0, 0.0, 1.3, pitch_rad=0.5)


@pytest.fixture
def folder(tmp_path):
    """A camera 1.3 m above a floor, in a world that is its own frame at first."""
    rays = pixel_rays(CAMERA, MOUNT)
    depth = np.where(rays[..., 2] < 0, -1.3 / np.minimum(rays[..., 2], -1e-6), 0.0)
    depth = np.where(depth < 5.0, depth, 0.0)
    (tmp_path / "camera-intrinsics.txt").write_text("60 0 39.5\n0 60 29.5\n0 0 1\n")
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"frame-{number:06d}.depth.png"), np.round(depth * 1000).astype(np.uint16))
        np.savetxt(tmp_path / f"frame-{number:06d}.pose.txt", np.eye(4))
    return tmp_path


def mount_of(path, config=None):
    with DepthFolder(path) as recording:
        poses = recorded_ground(recording, config or Config()).poses
        for message in recording:
            if isinstance(message, Transform):
                poses.add(message)
    return poses.mount


def test_the_floor_is_found_where_gravity_is_told(folder):
    down = MOUNT.T_base_optical[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    (folder / GRAVITY).write_text(" ".join(map(str, down.tolist())))
    found = mount_of(folder)
    assert found.z_m == pytest.approx(1.3, abs=0.06)
    assert (found.roll_rad, found.pitch_rad) == pytest.approx((0.0, 0.5), abs=1e-6)


def test_without_gravity_the_world_is_level_with_its_floor_at_0(folder):
    for number in range(3):
        np.savetxt(folder / f"frame-{number:06d}.pose.txt", MOUNT.T_base_optical)
    found = mount_of(folder)
    assert (found.z_m, found.pitch_rad) == pytest.approx((1.3, 0.5), abs=1e-6)


def driven(x_m, yaw_rad, mount=MOUNT):
    """T_world_optical of the camera on a car that drove so far, in the world of its first image."""
    place = se2.to_matrix4([x_m, 0.0, yaw_rad]) @ mount.T_base_optical
    return np.linalg.inv(mount.T_base_optical) @ place


def test_without_gravity_the_mount_on_the_car_tells_what_is_level(folder):
    for number in range(3):
        np.savetxt(folder / f"frame-{number:06d}.pose.txt", driven(0.3 * number, 0.4 * number))
    config = parse({"depth": {"mount": {"z_m": 1.3, "pitch_rad": 0.5}}}, "test")
    found = mount_of(folder, config)
    assert (found.z_m, found.roll_rad, found.pitch_rad) == pytest.approx((1.3, 0.0, 0.5), abs=1e-6)
    with DepthFolder(folder) as recording:
        ground = recorded_ground(recording, config)
    assert ground.of_camera
    assert "depth.mount" in ground.level


def test_a_hand_held_camera_without_gravity_is_refused(folder):
    for number in range(3):
        tilted = CameraMount(0.0, 0.0, 1.3, pitch_rad=0.5 + 0.2 * number)
        pose = np.linalg.inv(MOUNT.T_base_optical) @ tilted.T_base_optical
        np.savetxt(folder / f"frame-{number:06d}.pose.txt", pose)
    with pytest.raises(RecordingError, match=f"where down is.*{GRAVITY}"):
        mount_of(folder)


@pytest.mark.parametrize("text", ["0 1\n", "", "a b c", "0 0 0", "nan 0 1", "0 inf 0"])
def test_a_bad_vector_is_one_clear_line(folder, text):
    (folder / GRAVITY).write_text(text)
    with pytest.raises(RecordingError, match="three numbers"):
        mount_of(folder)
