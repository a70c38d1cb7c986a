"""The rover on real addresses: UDP and a pseudo-terminal, in real time, driven by our own link."""

import json
import os
import subprocess
import sys
import threading
import time

import pytest

from drivers.errors import SilentPortError
from drivers.mavlink_address import MavlinkAddress, parse_address
from drivers.mavlink_vehicle import MavlinkVehicle, open_mavlink
from drivers.vehicle import DriveCommand, LostVehicleError, VehicleState
from mapping.trajectory import read_tum
from tools.errors import UsageError
from tools.rover_emulation import make_rover, network_address, serve_rover

pytestmark = [pytest.mark.live(cores=1), pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")]


@pytest.fixture
def served(capsys):
    """Start a rover in a thread; give back its address and what ends it."""
    ending = []

    def serve(rover, address: MavlinkAddress | None, **options) -> str:
        stop = threading.Event()
        arguments = {"as_json": True, **options}
        thread = threading.Thread(target=serve_rover, args=(rover, address, stop), kwargs=arguments)
        thread.start()
        ending.append((stop, thread))
        told = ""
        while "\n" not in told:
            told += capsys.readouterr().out
            time.sleep(0.01)
        return str(json.loads(told.splitlines()[0])["address"])

    def end() -> None:
        for stop, thread in ending:
            stop.set()
            thread.join()

    serve.end = end  # type: ignore[attr-defined]
    yield serve
    end()


def drive(vehicle: MavlinkVehicle, command: DriveCommand, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        vehicle.drive(command)
        vehicle.poll()
        time.sleep(0.02)


@pytest.mark.parametrize("way", ["udp", "serial"])
def test_drives_there_and_stops(served, tmp_path, way: str) -> None:
    rover, truth = make_rover((1.0, 2.0, 0.0), [], None, 0), tmp_path / "truth.tum"
    if way == "udp":
        ours = parse_address("udp:127.0.0.1:24651")
        served(rover, network_address("udpout:127.0.0.1:24651"), truth=truth)
    else:
        ours = parse_address(served(rover, None, truth=truth))
    with open_mavlink(ours, time.monotonic_ns) as vehicle:
        vehicle.arm()
        drive(vehicle, DriveCommand(0.5, 0.0), 1.5)
        began = time.perf_counter()
        vehicle.drive(DriveCommand(0.0, 0.0))
        assert time.perf_counter() - began < 0.1
        vehicle.stop()
        time.sleep(0.8)
        states = [message for message in vehicle.poll() if isinstance(message, VehicleState)]
        assert rover.state.speed_mps == 0.0
        assert states[-1].mode == "HOLD"
    served.end()
    drives = read_tum(truth).poses
    assert 0.3 < drives[-1, 0] - 1.0 < 1.2
    assert abs(drives[-1, 1] - 2.0) < 1e-3


def test_a_cut_cable_is_noticed_by_both_ends(served) -> None:
    rover = make_rover((0.0, 0.0, 0.0), ["cut@4"], 1.0, 0)
    address = served(rover, None)
    with open_mavlink(parse_address(address), time.monotonic_ns) as vehicle:
        assert vehicle.setpoint_timeout_s == 1.0
        vehicle.arm()
        with pytest.raises(LostVehicleError):
            drive(vehicle, DriveCommand(0.3, 0.0), 12.0)
        assert rover.state.speed_mps == 0.0


DRIVER = """
import sys, time
from drivers.mavlink_address import parse_address
from drivers.mavlink_vehicle import open_mavlink
from drivers.vehicle import DriveCommand

with open_mavlink(parse_address(sys.argv[1]), time.monotonic_ns) as vehicle:
    vehicle.arm()
    while True:
        vehicle.drive(DriveCommand(0.5, 0.3))
        vehicle.poll()
        time.sleep(0.02)
"""


@pytest.mark.parametrize("way", ["udp", "serial"])
def test_a_killed_driver_is_stopped_by_the_vehicles_timeout(served, way: str, project_root) -> None:
    rover = make_rover((0.0, 0.0, 0.0), [], 1.0, 0)
    if way == "udp":
        address = "udp:127.0.0.1:24653"
        served(rover, network_address("udpout:127.0.0.1:24653"))
    else:
        address = served(rover, None)
    search = os.pathsep.join((str(project_root), os.environ.get("PYTHONPATH", "")))
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, address], env={**os.environ, "PYTHONPATH": search})
    try:
        end = time.monotonic() + 30.0
        while rover.state.speed_mps < 0.5:
            assert time.monotonic() < end
            time.sleep(0.01)
    finally:
        driver.kill()
        driver.wait()
    killed = time.monotonic()
    while rover.state.speed_mps > 0.0:
        assert time.monotonic() < killed + 10.0
        time.sleep(0.005)
    # Its timeout + 0.1 s, latency, v / a, and 0.2 s for a busy computer.
    assert 0.9 < time.monotonic() - killed < 1.0 + 0.1 + 0.1 + 0.5 / 1.5 + 0.2


def test_nobody_speaks_at_an_address() -> None:
    vehicle = open_mavlink(parse_address("udp:127.0.0.1:24659"), time.monotonic_ns)
    with pytest.raises(SilentPortError, match=r"udp:127.0.0.1:24659: nothing arrives"):
        vehicle.__enter__()


@pytest.mark.parametrize("text", ["tcp:127.0.0.1:1", "serial:/dev/x:1", "nowhere"])
def test_other_addresses_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--to"):
        network_address(text)


def test_unknown_faults_are_refused() -> None:
    with pytest.raises(UsageError, match="--fault 'fire': unknown"):
        make_rover((0.0, 0.0, 0.0), ["fire"], None, 0)
