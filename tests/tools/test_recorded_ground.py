from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.depth_folder import DepthFolder
from drivers.errors import RecordingError
from drivers.messages import Pinhole, Transform
from mapping.depth_projection import CameraMount, pixel_rays
from tools.config import Config
from tools.recorded_ground import GRAVITY, recorded_poses

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


def mount_of(path):
    with DepthFolder(path) as recording:
        poses = recorded_poses(recording, Config())
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


def test_a_bad_vector_is_one_clear_line(folder):
    (folder / GRAVITY).write_text("0 1\n")
    with pytest.raises(RecordingError, match="three numbers"):
        mount_of(folder)
