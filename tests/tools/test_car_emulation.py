"""The whole car: on simulated time without ports, and on real addresses in real time, driven by our own link."""

from __future__ import annotations

import json
import sys
import threading
import time

import numpy as np
import pytest

from drivers.mavlink_address import MavlinkAddress, parse_address
from drivers.mavlink_constants import RoverMode
from drivers.mavlink_vehicle import open_mavlink
from drivers.rplidar import open_rplidar
from drivers.rplidar_models import A2M8
from drivers.vehicle import DriveCommand
from mapping.trajectory import read_tum
from tools.car_emulation import CarWanted, EmulatedVehicle, rover_address, serve_car
from tools.config import Config
from tools.emulation import read_faults
from tools.errors import UsageError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")

NORTH = (1.6, 3.6, np.pi / 2.0)  # in the office: the wall's face is at y 4.94 m, the car's front 0.3405 m ahead
STANDS_Y_M = 4.94 - 0.3405


@pytest.fixture
def vehicle():
    """A car that looks north, and that nobody serves."""
    made = EmulatedVehicle(CarWanted("office", NORTH, A2M8, noisy=False))
    yield made
    made.sensor.port.close()


def test_the_laser_sees_what_the_rover_drives_and_the_wall_stops_both(vehicle):
    start_ns = int(vehicle.world.truth[0][0])
    vehicle.rover.autopilot.set_mode(RoverMode.GUIDED)
    vehicle.rover.autopilot.set_armed(True)
    seen = []
    for tick in range(100):
        now_ns = start_ns + tick * 50_000_000
        vehicle.rover.autopilot.set_target(0.5, 0.0, now_ns)
        vehicle.car.due(now_ns)
        forward = Config().mount().pose[2]
        seen.append(float(vehicle.car(np.full(1, now_ns, np.int64), np.full(1, forward))[0]))
    stamps_ns, poses, speeds_mps = vehicle.world.truth
    assert poses[-1, 1] == pytest.approx(STANDS_Y_M, abs=0.025)  # a cell of the world
    assert speeds_mps[-1] == 0.0
    assert vehicle.rover.contacts == 1
    ahead_m = seen[-1] + Config().mount().pose[0]
    assert ahead_m == pytest.approx(0.3405, abs=0.04)
    assert seen[0] - seen[-1] == pytest.approx(poses[-1, 1] - NORTH[1], abs=0.025)
    assert set(np.diff(stamps_ns)) == {10_000_000}


@pytest.mark.parametrize(("pose", "words"), [((-9.0, 0.0, 0.0), "outside of the world"), ((1.6, 4.7, 1.6), "touches")])
def test_where_no_car_can_stand_none_is_made(pose, words):
    with pytest.raises(UsageError, match=words):
        EmulatedVehicle(CarWanted("office", pose, A2M8))


@pytest.mark.parametrize("text", ["tcp:127.0.0.1:1", "serial:", "nowhere"])
def test_other_addresses_are_refused(text):
    with pytest.raises(UsageError, match="--rover"):
        rover_address(text)


@pytest.mark.parametrize("options", [("--pose", "nan", "0", "0"), ("--pose", "1", "1", "0", "--model", "A1"), ()])
def test_options_that_do_not_fit_are_wrong_usage(options, cli):
    assert cli("emulate", "car", *options).code == 2


class Served:
    """A car that is served in a thread."""

    def __init__(self, wanted: CarWanted, address: MavlinkAddress, capsys, **options) -> None:
        self._capsys, self._told = capsys, ""
        self._stop = threading.Event()
        arguments = {"as_json": True, "truth": None, **options}
        vehicle = EmulatedVehicle(wanted)
        self._thread = threading.Thread(target=serve_car, args=(vehicle, address, self._stop), kwargs=arguments)
        self._thread.start()
        self.ready = self.event("ready")

    def events(self) -> list[dict[str, object]]:
        """All so far."""
        self._told += self._capsys.readouterr().out
        return [json.loads(line) for line in self._told.splitlines(keepends=True) if line.endswith("\n")]

    def event(self, name: str, patience_s: float = 10.0) -> dict[str, object]:
        """Wait for one."""
        ends_at = time.monotonic() + patience_s
        while time.monotonic() < ends_at:
            for event in self.events():
                if event["event"] == name:
                    return event
            time.sleep(0.02)
        raise AssertionError(f"no {name} in {self.events()}")

    def end(self) -> None:
        """Press Ctrl-C for it."""
        self._stop.set()
        self._thread.join()


@pytest.mark.live(cores=1)
@pytest.mark.parametrize("way", ["udp", "serial"])
def test_drives_into_the_wall_in_real_time_and_says_so(way, tmp_path, capsys):
    truth, link = tmp_path / "truth.tum", tmp_path / "lidar"
    address = rover_address("udp:127.0.0.1:0" if way == "udp" else f"serial:{tmp_path / 'rover'}")
    wanted = CarWanted("office", NORTH, A2M8, lidar_link=link)
    served = Served(wanted, address, capsys, truth=truth)
    try:
        with (
            open_mavlink(parse_address(str(served.ready["vehicle"])), time.monotonic_ns) as rover,
            open_rplidar(str(served.ready["lidar"])) as lidar,
        ):
            rover.arm()
            measured = iter(lidar)
            ends_at = time.monotonic() + 20.0
            while not any(event["event"] == "contact" for event in served.events()):
                assert time.monotonic() < ends_at
                rover.drive(DriveCommand(0.5, 0.0))
                rover.poll()
                assert next(measured) is not None
            rover.stop()
            time.sleep(0.3)
    finally:
        served.end()
    stopped = served.event("stopped")
    assert stopped["contacts"] == 1
    assert stopped["y"] == pytest.approx(STANDS_Y_M, abs=0.025)
    assert int(str(stopped["samples_emitted"])) > 1000
    assert served.event("departed")
    drive = read_tum(truth)
    assert drive.poses[-1, 1] == pytest.approx(STANDS_Y_M, abs=0.025)
    assert abs(drive.stamps_ns[-1] * 1e-9 - time.time()) < 30.0
    speeds_mps = np.hypot(*np.diff(drive.poses[:, :2], axis=0).T) / (np.diff(drive.stamps_ns) * 1e-9)
    assert speeds_mps.max() <= 0.5 + 1e-6


@pytest.mark.live(cores=1)
def test_faults_of_either_device_are_those_of_the_devices(tmp_path, capsys):
    link = tmp_path / "lidar"
    wanted = CarWanted(
        "office",
        NORTH,
        A2M8,
        lidar_link=link,
        script=read_faults(["unplug@0.5"], None, 0),
        rover_faults=("refuse-arm",),
    )
    served = Served(wanted, rover_address("udp:127.0.0.1:0"), capsys)
    try:
        with open_rplidar(str(link)) as lidar:
            next(iter(lidar))
            served.event("unplugged")
    finally:
        served.end()
    assert not link.exists()
