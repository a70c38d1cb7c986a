"""A car that is served by a thread, driven by our own link: what it keeps of a stop."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from drivers.mavlink_address import parse_address
from drivers.mavlink_vehicle import open_mavlink
from drivers.vehicle import DriveCommand
from tools.watched_car import WatchedCar

pytestmark = [pytest.mark.live(cores=1), pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")]


def test_a_stop_is_measured_from_its_event_to_standing(tmp_path):
    car = WatchedCar("office", np.array([1.6, 3.6, 0.0]), tmp_path / "lidar", 0)
    try:
        with open_mavlink(parse_address(car.address), time.monotonic_ns) as vehicle:
            vehicle.arm()
            end = time.monotonic() + 20.0
            while not (car.setpoints and car.is_driven):
                assert time.monotonic() < end
                vehicle.drive(DriveCommand(0.4, 0.0))
                vehicle.poll()
                time.sleep(0.02)
            event_ns = car.now_ns()
            vehicle.emergency_stop()
            while not car.stands:
                vehicle.poll()
                time.sleep(0.02)
        time.sleep(0.1)
    finally:
        car.close()
    stop = car.stop_after(event_ns)
    assert 0.0 <= stop.command_s < 0.3
    assert stop.command_s < stop.stood_s < stop.command_s + 0.1 + 0.4 / 1.5 + 0.3
    assert 0.2 < stop.event_mps <= 0.4 + 1e-6
