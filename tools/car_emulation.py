"""An emulated car in real time: its RPLIDAR and its MAVLink rover on the addresses that real ones would have.

One world and one truth: the lidar looks from where the rover's commands have brought the car, and a wall stops it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.datagram_link import DatagramLink
from drivers.emulated_faults import FaultScript
from drivers.mavlink_address import MavlinkAddress
from drivers.mavlink_rover import MavlinkRover
from drivers.pty_port import PtyPort
from drivers.rplidar_models import EmulatedModel
from mapping.trajectory import Trajectory, write_tum
from tools.announcement import announce
from tools.clock import PatientClock, RunClock
from tools.config import Config
from tools.driven_world import DrivenWorld
from tools.emulation import EmulatedSensor
from tools.errors import UsageError
from tools.results import writing_to
from tools.rover_emulation import SERIAL_BAUD, make_rover, network_address, serve_over_network
from tools.wall_contact import Room
from tools.world import load_world

FloatArray = NDArray[np.float64]

_POLL_S = 0.005
_TRUTH_STEPS = 5  # of 10 ms, between two poses of the truth that is written
_DEPARTED_M = 0.001


class CarInWorld:
    """The rover of a world as an emulated device, and the world as a ranger, both from any thread.

    Before the rover hears or says anything, and before the laser looks, the car drives up to then.
    """

    def __init__(self, world: DrivenWorld, rover: MavlinkRover) -> None:
        self._world, self._rover = world, rover
        self._lock = threading.Lock()

    def __call__(self, times_ns: NDArray[np.int64], theta_cw_rad: FloatArray) -> FloatArray:
        """Return what the laser measures: see DrivenWorld."""
        with self._lock:
            return self._world(times_ns, theta_cw_rad)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take bytes for the rover; return what it answers."""
        with self._lock:
            self._world.advance(now_ns)
            return self._rover.receive(data, now_ns)

    def due(self, now_ns: int) -> bytes:
        """Return what the rover sends of its own accord."""
        with self._lock:
            self._world.advance(now_ns)
            return self._rover.due(now_ns)


@dataclass(frozen=True, slots=True)
class CarWanted:
    """What the command line asks for: a pose (x, y, yaw) in a world, the lidar's model, faults of both devices.

    lidar_link: a symbolic link to the lidar's port. timeout_s: the rover's for setpoints, ArduRover's own where None.
    """

    world: str
    pose: tuple[float, float, float]
    model: EmulatedModel
    lidar_link: Path | None = None
    script: FaultScript | None = None
    rover_faults: Sequence[str] = ()
    timeout_s: float | None = None
    noisy: bool = True
    seed: int = 0


class EmulatedVehicle:
    """A standing car with its devices, which share one world and one clock; raises MapFileError and UsageError."""

    def __init__(self, wanted: CarWanted) -> None:
        walls = load_world(wanted.world)
        room = Room(walls)
        x_m, y_m, yaw_rad = wanted.pose
        if not room(np.array(wanted.pose)):
            reason = walls.objection(x_m, y_m) or "the car touches a wall there"
            raise UsageError(f"--pose {x_m:g} {y_m:g} {yaw_rad:g} in {wanted.world}: {reason}: begin elsewhere")
        walls.ranges(np.zeros((1, 3)), np.zeros(1), 1.0)  # loads compiled code before the first client comes
        self.clock = PatientClock()
        self.rover = make_rover(wanted.pose, wanted.rover_faults, wanted.timeout_s, wanted.seed, fits=room)
        mount = Config().mount()
        self.world = DrivenWorld(walls, self.rover, mount, start_ns=self.clock(), seed=wanted.seed, noisy=wanted.noisy)
        self.car = CarInWorld(self.world, self.rover)
        self.sensor = EmulatedSensor(
            wanted.model, self.car, script=wanted.script, link=wanted.lidar_link, clock=self.clock
        )


def rover_address(text: str) -> MavlinkAddress:
    """Return an address of the command line, a network's or serial:PATH; raises UsageError."""
    path = text.removeprefix("serial:")
    if path != text and path:
        return MavlinkAddress("serial", path, SERIAL_BAUD)
    return network_address(text, "--rover", "serial:PATH makes a serial port")


def serve_car(
    emulated: EmulatedVehicle, address: MavlinkAddress, stop: threading.Event, *, truth: Path | None, as_json: bool
) -> None:
    """Serve until `stop`; announce on stdout what happens. truth: where the true drive goes at the end (TUM)."""
    sensor, world, rover, clock = emulated.sensor, emulated.world, emulated.rover, RunClock()
    with ExitStack() as ending:
        ending.enter_context(sensor.port)
        vehicle, serve = ending.enter_context(_rover_served(emulated, address, stop))
        model = sensor.emulator.model
        announce(as_json, "ready", lidar=sensor.address, vehicle=vehicle, model=model.name, baud=model.baud)
        watch = _Watch(emulated, as_json)
        while not stop.is_set():
            serve()
            watch.tell()
    stamps_ns, poses, _ = world.truth
    stamps_ns, poses = stamps_ns[::_TRUTH_STEPS], poses[::_TRUTH_STEPS]
    drive = Trajectory(emulated.clock.monotonic_ns(stamps_ns) + clock.offset_ns, poses)
    if truth is not None:
        with writing_to(truth):
            write_tum(truth, drive)
    x_m, y_m, yaw_rad = (round(value, 3) for value in rover.state.pose.tolist())
    announce(
        as_json,
        "stopped",
        x=x_m,
        y=y_m,
        yaw=yaw_rad,
        driven_m=round(drive.length_m, 2),
        contacts=rover.contacts,
        samples_emitted=sensor.emulator.counters.samples_emitted,
        bytes_lost=sensor.port.bytes_lost,
        waited_s=round(emulated.clock.waited_s, 2),
    )


@contextmanager
def _rover_served(
    emulated: EmulatedVehicle, address: MavlinkAddress, stop: threading.Event
) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield the address of the rover for whoever drives it, and what serves it for some 5 ms."""
    if address.kind == "serial":
        link = Path(address.place)
        with PtyPort(emulated.car, SERIAL_BAUD, link=link, clock=emulated.clock):
            yield f"serial:{link}:{SERIAL_BAUD}", lambda: stop.wait(_POLL_S)
        return
    listens = address.kind != "udpout"
    with DatagramLink(address.place, address.number, listen=listens) as network:
        there = f"{address.place}:{network.port if listens else address.number}"
        serve = lambda: serve_over_network(emulated.car, network, emulated.clock)  # noqa: E731
        yield f"{'udpout' if listens else 'udp'}:{there}", serve


class _Watch:
    """Announces what happens to the car while it is served."""

    def __init__(self, emulated: EmulatedVehicle, as_json: bool) -> None:
        self._emulated, self._as_json = emulated, as_json
        self._state: tuple[str, bool] | None = None
        self._start = emulated.rover.state.pose
        self._departed = False
        self._contacts = 0

    def tell(self) -> None:
        """Announce what is new."""
        rover, sensor = self._emulated.rover, self._emulated.sensor
        event = sensor.follow_script()
        if event is not None:
            announce(self._as_json, event, address=sensor.address)
        state = (rover.autopilot.mode.name, rover.autopilot.armed)
        if state != self._state:
            self._state = state
            announce(self._as_json, "state", mode=state[0], armed=state[1])
        pose = rover.state.pose
        if not self._departed and np.hypot(*(pose - self._start)[:2]) > _DEPARTED_M:
            self._departed = True
            announce(self._as_json, "departed")
        if rover.contacts > self._contacts:
            self._contacts = rover.contacts
            x_m, y_m, yaw_rad = (round(value, 3) for value in pose.tolist())
            announce(self._as_json, "contact", number=self._contacts, x=x_m, y=y_m, yaw=yaw_rad)
