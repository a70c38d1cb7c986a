"""MAVSDK, another MAVLink implementation, at either end: as an autopilot to our link, as a client to our rover.

No dependency of this project: `pip install --target DIR mavsdk==4.1.0`, then MAPFUSE_PEERS=DIR. As an autopilot
it speaks PX4's modes, where GUIDED is called OFFBOARD.
"""

import json
import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.datagram_link import DatagramLink
from drivers.mavlink_address import parse_address
from drivers.mavlink_settings import MavlinkSettings
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.vehicle import ArmingRefusedError, DriveCommand, LostVehicleError
from tools.rover_emulation import make_rover, serve_rover

pytestmark = pytest.mark.live(cores=1)

# In a process of its own each: its library keeps threads, and writes to the terminal.
AUTOPILOT = """
import json, sys, time
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.component_type import ComponentType
from mavsdk.plugins.action_server.action_server import ActionServer, AllowableFlightModes
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import MavlinkDirectServer
from mavsdk.plugins.param_server.param_server import ParamServer

sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
sdk.add_any_connection(sys.argv[1])
component = sdk.server_component()
parameters = ParamServer(component)
parameters.provide_param_float("GUID_TIMEOUT", 1.5)
parameters.provide_param_int("FS_GCS_ENABLE", 1)
actions = ActionServer(component)
armable = sys.argv[2] == "armable"
actions.set_armable(armable, armable)
actions.set_disarmable(True, True)
actions.set_allowable_flight_modes(AllowableFlightModes(True, True, True))
direct = MavlinkDirectServer(component)


def tell(message, *_):
    print("@" + json.dumps([message.message_name, json.loads(message.fields_json)]), flush=True)


for name in ("SET_POSITION_TARGET_LOCAL_NED", "ODOMETRY", "OBSTACLE_DISTANCE", "HEARTBEAT"):
    direct.subscribe_message(name, tell)
time.sleep(60)
"""
CLIENT = """
import json, sys, time
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.component_type import ComponentType
from mavsdk.plugins.action.action import Action
from mavsdk.plugins.offboard.offboard import Offboard, VelocityBodyYawspeed
from mavsdk.plugins.param.param import Param

sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
sdk.add_any_connection(sys.argv[1])
system = sdk.first_autopilot(10.0)
tell = lambda what, value: print("@" + json.dumps([what, value]), flush=True)
tell("autopilot", int(system.autopilot_type()))
tell("parameter", Param(system).get_param_float("GUID_TIMEOUT"))
tell("armed", int(Action(system).arm()))
offboard = Offboard(system)
offboard.set_velocity_body(VelocityBodyYawspeed(0.4, 0.0, 0.0, 20.0))
tell("started", int(offboard.start()))
time.sleep(3.0)
tell("driven", 0)
time.sleep(30)
"""


class Peer:
    """A program with MAVSDK; its lines that begin with @ are collected."""

    def __init__(self, program: str, *arguments: str) -> None:
        self.told: list = []
        self._other: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            env={**os.environ, "PYTHONPATH": os.environ["MAPFUSE_PEERS"]},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("@"):
                self.told.append(json.loads(line[1:]))
            else:
                self._other.append(line)

    def of(self, name: str) -> list:
        return [fields for kind, fields in list(self.told) if kind == name]

    def wait_for(self, name: str, seconds: float = 20.0) -> object:
        end = time.monotonic() + seconds
        while not self.of(name):
            assert time.monotonic() < end, "".join(self._other[-20:])
            time.sleep(0.02)
        return self.of(name)[0]

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._thread.join()
        assert self._process.stdout is not None
        self._process.stdout.close()


@pytest.fixture
def peer():
    """Starts peers and ends them."""
    folder = os.environ.get("MAPFUSE_PEERS")
    if not folder or not (Path(folder) / "mavsdk").is_dir():
        pytest.skip("mavsdk is missing")
    running: list[Peer] = []

    def start(program: str, *arguments: str) -> Peer:
        running.append(Peer(program, *arguments))
        return running[-1]

    yield start
    for each in running:
        each.kill()


def free_port() -> int:
    with DatagramLink("127.0.0.1", 0, listen=True) as link:
        return link.port


def patient(port: int) -> MavlinkVehicle:
    """Our link, with time for another process to start."""
    address = parse_address(f"udp:127.0.0.1:{port}")
    return MavlinkVehicle(str(address), address.open, time.monotonic_ns, settings=MavlinkSettings(connect_s=20.0))


def test_mavsdk_as_autopilot_is_armed_and_driven_by_our_link(peer) -> None:
    port = free_port()
    autopilot = peer(AUTOPILOT, f"udpout://127.0.0.1:{port}", "armable")
    vehicle = patient(port)
    with vehicle:
        assert vehicle.parameters == {"GUID_TIMEOUT": 1.5, "FS_GCS_ENABLE": 1.0}  # a whole number and a float
        vehicle.arm()
        for _ in range(30):
            vehicle.drive(DriveCommand(0.5, 0.8))
            vehicle.poll()
            time.sleep(0.05)
        vehicle.tell_pose(0, np.array([1.0, 2.0, 0.5]), np.zeros(3))
        time.sleep(0.3)
        driven = [fields for fields in autopilot.of("SET_POSITION_TARGET_LOCAL_NED") if fields["vx"] > 0]
        assert len(driven) >= 25
        assert (driven[-1]["coordinate_frame"], driven[-1]["type_mask"]) == (8, 1511)
        assert driven[-1]["vx"] == pytest.approx(0.5)
        assert driven[-1]["yaw_rate"] == pytest.approx(-0.4)  # left, told in axes whose yaw is clockwise
        vehicle.stop()
        time.sleep(0.3)
        assert autopilot.of("SET_POSITION_TARGET_LOCAL_NED")[-1]["vx"] == 0.0
        odometry = autopilot.of("ODOMETRY")[-1]
        assert (odometry["x"], odometry["y"]) == (1.0, -2.0)
        assert 2 * math.atan2(odometry["q"][3], odometry["q"][0]) == pytest.approx(-0.5)
        assert len(autopilot.of("HEARTBEAT")) >= 2


def test_mavsdk_that_refuses_to_arm_and_then_dies(peer) -> None:
    port = free_port()
    autopilot = peer(AUTOPILOT, f"udpout://127.0.0.1:{port}", "not armable")
    vehicle = patient(port)
    with vehicle:
        with pytest.raises(ArmingRefusedError, match="does not arm"):
            vehicle.arm()
        autopilot.kill()
        began = time.monotonic()

        def wait() -> None:
            while time.monotonic() < began + 6.0:
                vehicle.poll()
                time.sleep(0.05)

        with pytest.raises(LostVehicleError):
            wait()
        assert time.monotonic() - began < 3.0


def test_mavsdk_as_client_arms_and_drives_our_rover(peer) -> None:
    port, stop = free_port(), threading.Event()
    rover = make_rover((0.0, 0.0, 0.0), [], None, 0)
    serving = threading.Thread(
        target=serve_rover, args=(rover, parse_address(f"udpout:127.0.0.1:{port}"), stop), kwargs={"as_json": True}
    )
    serving.start()
    try:
        client = peer(CLIENT, f"udpin://127.0.0.1:{port}")
        client.wait_for("driven", 40.0)
        assert client.of("autopilot") == [2]  # ArduPilot
        assert client.of("parameter") == [3.0]
        assert rover.autopilot.armed
        assert rover.autopilot.mode.name == "GUIDED"
        # 20 deg/s to the right, as body axes with z down count it.
        assert rover.state.speed_mps == pytest.approx(0.4)
        assert rover.state.yaw_rate_radps == pytest.approx(-math.radians(20.0), rel=1e-3)
        client.kill()
        time.sleep(3.0 + 0.1 + 0.1 + 0.4 / 1.5)
        assert rover.state.speed_mps == 0.0
    finally:
        stop.set()
        serving.join()
