"""A vehicle that is told where it is and never driven, in a session without sensors."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from drivers.messages import Imu, LaserScan, Recordable
from drivers.vehicle import LostVehicleError, NullVehicle
from mapping import se2
from mapping.mount import Mount
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from tools.bell import Bell
from tools.clock import RunClock
from tools.live_telling import LiveTelling
from tools.session_parts import LiveSession

pytestmark = pytest.mark.live(cores=1)


class Listener(NullVehicle):
    """Keeps what it is told, sends an IMU's message each time, and is lost when it is told to be."""

    def __init__(self):
        super().__init__(time.monotonic_ns)
        self.poses, self.scans, self.orders = [], [], []
        self.is_lost = False

    def poll(self):
        if self.is_lost:
            raise LostVehicleError("rover: no heartbeat")
        return [*super().poll(), Imu(1, np.zeros(3), np.zeros(3))]

    def tell_pose(self, stamp_ns, T_map_base, twist, *, jumped=False):
        self.poses.append(np.array(T_map_base))

    def tell_scan(self, scan, T_base_laser):
        self.scans.append(scan)

    def arm(self):
        self.orders.append("arm")

    def drive(self, command):
        self.orders.append("drive")

    def stop(self):
        self.orders.append("stop")

    def emergency_stop(self):
        self.orders.append("cut")


def mapped(stamp_ns, pose):
    return MappedScan(stamp_ns, pose, ScanMatch(pose, np.zeros(3), accepted=True), np.zeros((1, 2)), False, False)


def wait_for(reached):
    end = time.monotonic() + 20.0
    while not reached():
        assert time.monotonic() < end, "it does not come"
        time.sleep(0.005)


@pytest.fixture
def told():
    """A part that has begun, the vehicle, and what was recorded."""
    vehicle = Listener()
    recorded: list[Recordable] = []
    with Bell() as bell:
        part = LiveTelling(vehicle, bell)
        part.begin(LiveSession(RunClock(), Mount(), recorded.append, threading.Event()))
        yield part, vehicle, recorded
        part.end()


def test_pose_and_scan_go_to_the_vehicle_and_its_imu_into_the_recording(told, tmp_path):
    part, vehicle, recorded = told
    pose = np.array([1.0, 2.0, 0.5])
    part.note(LaserScan(0, np.zeros(1), np.ones(1), np.zeros(1), 0.1, 12.0))
    part.add(mapped(time.time_ns(), pose))
    wait_for(lambda: vehicle.poses and vehicle.scans and recorded)
    np.testing.assert_allclose(se2.between(pose, vehicle.poses[0]), np.zeros(3), atol=1e-9)
    assert isinstance(recorded[0], Imu)
    part.end()
    assert vehicle.orders == [], "nobody drives it from here"
    assert part.save(tmp_path)["vehicle"] == {"name": "none", "driven": False, "fault": None}


def test_a_lost_vehicle_ends_the_telling_and_nothing_else(told, tmp_path, caplog):
    part, vehicle, _ = told
    vehicle.is_lost = True
    wait_for(lambda: part.fault)
    assert part.failure is None
    assert "mapping and recording go on" in caplog.text
    assert part.save(tmp_path)["vehicle"]["fault"] == "rover: no heartbeat"
