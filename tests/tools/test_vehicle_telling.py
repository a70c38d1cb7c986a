"""What a vehicle is told: poses as of now, jumps apart from driving, each scan once."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.messages import LaserScan
from drivers.vehicle import NullVehicle
from mapping import se2
from mapping.mount import Mount
from mapping.relocalisation import Located
from tools.vehicle_telling import PoseTold, VehicleTelling


def located(stamp_ns, pose=(0.0, 0.0, 0.0), correction=(0.0, 0.0, 0.0)):
    """A place whose odometry says `pose`, and the map another one by the correction."""
    correction = np.array(correction)
    return Located(stamp_ns, se2.compose(correction, np.array(pose)), correction, np.eye(3), 1.0, "")


def test_poses_are_told_as_of_now_and_jumps_apart_from_driving():
    told, way = PoseTold(), np.array([0.05, 0.0, 0.05])
    first, second = located(0), located(100_000_000, way)
    assert told.is_new(first)
    told.take(first, 0)
    assert not told.is_new(first)
    pose, twist, jumped = told.take(second, 200_000_000)
    np.testing.assert_allclose(twist, [0.5, 0.0, 0.5])
    np.testing.assert_allclose(pose, se2.compose(way, way), atol=1e-3)
    assert not jumped
    _, twist, jumped = told.take(located(200_000_000, se2.compose(way, way), (0.2, 0.0, 0.0)), 200_000_000)
    np.testing.assert_allclose(twist, [0.5, 0.0, 0.5], atol=1e-9)
    assert jumped


class Listener(NullVehicle):
    def __init__(self):
        super().__init__(lambda: 0)
        self.poses, self.scans = [], []

    def tell_pose(self, stamp_ns, T_map_base, twist, *, jumped=False):
        self.poses.append(T_map_base)

    def tell_scan(self, scan, T_base_laser):
        self.scans.append((scan, T_base_laser))


@pytest.mark.parametrize("inverted", [False, True])
def test_each_place_and_scan_is_told_once_and_a_hanging_laser_the_right_way_round(inverted):
    vehicle, mount = Listener(), Mount(np.array([0.1, 0.0, 0.5]), inverted)
    telling = VehicleTelling(vehicle, mount)
    telling.tell(None, 0)
    telling.note_scan(LaserScan(0, np.array([0.25]), np.array([2.0]), np.zeros(1), 0.1, 12.0))
    for _ in range(2):
        telling.tell(located(0, (1.0, 2.0, 0.0)), 0)
    (pose,), ((scan, place),) = vehicle.poses, vehicle.scans
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.0])
    assert scan.angles_rad[0] == (-0.25 if inverted else 0.25)
    np.testing.assert_allclose(place, [0.1, 0.0, 0.5])
