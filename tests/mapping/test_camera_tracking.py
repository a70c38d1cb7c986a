from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.messages import DepthImage, Pinhole
from mapping.camera_tracking import CameraTracking
from mapping.cloud_odometry import CloudSettings
from mapping.depth_projection import CameraMount, pixel_rays

CAMERA = Pinhole(424, 240, 210.0, 210.0, 211.5, 119.5)
LOW, HIGH = np.array([-1.0, -1.5, 0.0]), np.array([2.5, 1.6, 2.2])  # a room on the floor


def seen_from(place, stamp_ns):
    """What a camera sees in the room from a CameraMount in the room's frame."""
    start = np.array([place.x_m, place.y_m, place.z_m])
    rays = pixel_rays(CAMERA, place)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_walls = np.where(rays > 0, (HIGH - start) / rays, (LOW - start) / rays)
    return DepthImage(stamp_ns, np.rint(to_walls.min(axis=2) * 1000.0).astype(np.uint16), 0.001, CAMERA)


def test_gravity_turns_with_a_camera_in_the_hand():
    first = CameraMount(0.0, 0.0, 1.2, roll_rad=0.1, pitch_rad=0.3)
    tracking = CameraTracking(CloudSettings(), in_hand=True)
    for number in range(25):
        place = replace(
            first, x_m=0.01 * number, z_m=1.2 + 0.01 * number, roll_rad=0.1 - 0.01 * number,
            pitch_rad=0.3 + 0.008 * number, yaw_rad=0.01 * number,
        )  # fmt: skip
        tracked = tracking.add(seen_from(place, 33_000_000 * number), first)
    assert tracked.pose == pytest.approx([place.x_m, 0.0, place.yaw_rad], abs=0.05)
    assert (tracked.mount.x_m, tracked.mount.y_m, tracked.mount.yaw_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert tracked.mount.z_m == pytest.approx(place.z_m, abs=0.05)
    assert tracked.mount.roll_rad == pytest.approx(place.roll_rad, abs=0.04)
    assert tracked.mount.pitch_rad == pytest.approx(place.pitch_rad, abs=0.04)


def test_a_car_s_pose_is_that_of_its_base_and_its_mount_stays():
    mount = CameraMount(0.2, 0.1, 0.5, pitch_rad=0.2, yaw_rad=0.3)
    tracking = CameraTracking(CloudSettings(), in_hand=False)
    for number in range(20):
        x, yaw = 0.02 * number, 0.015 * number
        cos, sin = np.cos(yaw), np.sin(yaw)
        place = replace(
            mount, x_m=x + cos * mount.x_m - sin * mount.y_m, y_m=sin * mount.x_m + cos * mount.y_m,
            yaw_rad=mount.yaw_rad + yaw,
        )  # fmt: skip
        tracked = tracking.add(seen_from(place, 33_000_000 * number), mount)
        assert tracked.mount is mount
    assert tracked.pose == pytest.approx([x, 0.0, yaw], abs=0.08)


def test_where_nothing_is_seen_the_last_tilt_is_kept():
    first = CameraMount(0.0, 0.0, 1.2, pitch_rad=0.3)
    empty = DepthImage(1, np.zeros((240, 424), np.uint16), 0.001, CAMERA)
    tracking = CameraTracking(CloudSettings(), in_hand=True)
    assert tracking.add(empty, first).pose is None
    assert tracking.add(empty, first).mount == first
    known = tracking.add(seen_from(first, 2), first)
    lost = tracking.add(replace(empty, stamp_ns=3), first)
    assert lost.pose is None
    assert lost.mount == known.mount
