"""An emulated rover on an address that a real one would have: MAVLink over UDP or on a pseudo-terminal."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.datagram_link import DatagramLink
from drivers.emulated_link import EmulatedDevice
from drivers.mavlink_address import AddressError, MavlinkAddress, parse_address
from drivers.mavlink_rover import MavlinkRover
from drivers.pty_port import PtyPort
from drivers.rover_dynamics import NoisyOdometry, RoverDynamics
from drivers.rover_faults import RoverFaultError, parse_rover_fault
from mapping.trajectory import Trajectory, write_tum
from tools.announcement import announce
from tools.clock import RunClock
from tools.errors import UsageError
from tools.results import writing_to

SERIAL_BAUD = 921600
_POLL_S = 0.005


def make_rover(
    pose: tuple[float, float, float],
    faults: Sequence[str],
    timeout_s: float | None,
    seed: int,
    *,
    fits: Callable[[NDArray[np.float64]], bool] = lambda _pose: True,
) -> MavlinkRover:
    """Return a rover at a pose, with faults of the command line and another setpoint timeout; raises UsageError.

    fits: see RoverDynamics.
    """
    try:
        parsed = [parse_rover_fault(fault) for fault in faults]
    except RoverFaultError as error:
        raise UsageError(f"--{error}") from error
    parameters = {} if timeout_s is None else {"GUID_TIMEOUT": timeout_s}
    odometry = NoisyOdometry(seed=seed)
    dynamics = RoverDynamics(np.array(pose), fits=fits)
    return MavlinkRover(dynamics, odometry=odometry, faults=parsed, parameters=parameters)


def network_address(text: str, option: str = "--to", otherwise: str = "--serial makes a serial port") -> MavlinkAddress:
    """Return the UDP address that an option gives; otherwise: how else it is done, for the error. UsageError."""
    try:
        address = parse_address(text)
    except AddressError as error:
        raise UsageError(f"{option}: {error}") from error
    if not address.kind.startswith("udp"):
        raise UsageError(f"{option} {text}: expected udpout:HOST:PORT or udp:HOST:PORT; {otherwise}")
    return address


def serve_over_network(device: EmulatedDevice, link: DatagramLink, clock: Callable[[], int]) -> None:
    """Exchange bytes once, waiting up to 5 ms for some."""
    received = link.read(_POLL_S)
    answers = device.receive(received, clock()) if received else b""
    if sent := answers + device.due(clock()):
        link.write(sent)


def serve_rover(
    rover: MavlinkRover,
    address: MavlinkAddress | None,
    stop: threading.Event,
    *,
    serial_link: Path | None = None,
    truth: Path | None = None,
    as_json: bool,
) -> None:
    """Serve until `stop`, at an address or, without one, on a pseudo-terminal; announce what happens on stdout.

    serial_link: a symbolic link to the pseudo-terminal. truth: where the true drive goes at the end (TUM).
    """
    clock = RunClock()
    told: tuple[object, ...] = ()
    stamps, poses = [clock()], [rover.state.pose]
    port = PtyPort(rover, SERIAL_BAUD, link=serial_link) if address is None else None
    network = DatagramLink(address.place, address.number, listen=address.kind != "udpout") if address else None
    place = f"serial:{serial_link or port.name}:{SERIAL_BAUD}" if port else str(address)
    announce(as_json, "ready", address=place)
    try:
        while not stop.is_set():
            if network is None:
                stop.wait(_POLL_S)
            else:
                serve_over_network(rover, network, clock.monotonic_ns)
            now_told = (rover.autopilot.mode.name, rover.autopilot.armed)
            if now_told != told:
                told = now_told
                announce(as_json, "state", mode=now_told[0], armed=now_told[1])
            if clock() - stamps[-1] >= 50_000_000:
                stamps.append(clock())
                poses.append(rover.state.pose)
    finally:
        if network is not None:
            network.close()
        if port is not None:
            port.close()
    if truth is not None:
        with writing_to(truth):
            write_tum(truth, Trajectory(np.array(stamps, dtype=np.int64), np.array(poses)))
    x_m, y_m, yaw_rad = (round(value, 3) for value in rover.state.pose.tolist())
    announce(as_json, "stopped", x=x_m, y=y_m, yaw=yaw_rad)
