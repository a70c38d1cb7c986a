"""An emulated car: its lidar on a pseudo-terminal, in a world, along a drive."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.pty_port import PtyPort
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import EmulatedModel
from mapping.trajectory import Trajectory, read_tum, write_tum
from tools.clock import RunClock
from tools.config import Config
from tools.emulated_camera import EmulatedCar
from tools.errors import UsageError
from tools.results import writing_to
from tools.simulator import SimulatedLidar, drive_along
from tools.world import TOURS, load_world

NOISE = (0.004, 0.003)  # m, and share of the range: an A2's ranges scatter by about 1 cm at 2 m
DROPOUT = 0.01
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Drive:
    """Where the car is over time; what to call it."""

    truth: Trajectory
    name: str

    @staticmethod
    def tour(name: str) -> Drive:
        """Return one of TOURS, the drives through a built-in world."""
        _, waypoints = TOURS[name]
        return Drive(drive_along(waypoints), f"{name} tour")

    @staticmethod
    def standing(pose: tuple[float, float, float]) -> Drive:
        """Return a car that stays where it is."""
        return Drive(Trajectory(np.zeros(1, dtype=np.int64), np.array([pose])), "standing")

    @staticmethod
    def from_file(path: Path) -> Drive:
        """Return the drive of a TUM file; raises TrajectoryError."""
        return Drive(read_tum(path), str(path))

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return float(np.ptp(self.truth.stamps_ns)) * 1e-9


def simulated_lidar(world: str, drive: Drive, *, noise: bool, seed: int) -> SimulatedLidar:
    """Return the laser of the emulated car, where the default configuration has it.

    Raises MapFileError, and UsageError for a drive that cannot begin where it does.
    """
    walls = load_world(world)
    x_m, y_m, _ = drive.truth.poses[0].tolist()
    objection = walls.objection(x_m, y_m)
    if objection is not None:
        raise UsageError(f"{drive.name} at x {x_m:g} m, y {y_m:g} m in {world}: {objection}: begin elsewhere")
    walls.ranges(np.zeros((1, 3)), np.zeros(1), 1.0)  # loads compiled code before the first client comes
    return SimulatedLidar(
        walls,
        drive.truth,
        Config().mount(),
        noise=NOISE if noise else (0.0, 0.0),
        dropout=DROPOUT if noise else 0.0,
        seed=seed,
    )


def serve_lidar(
    model: EmulatedModel,
    ranger: SimulatedLidar,
    drive: Drive,
    stop: threading.Event,
    *,
    truth: Path | None,
    link: Path | None,
    as_json: bool,
    car: Callable[[int | None], None] = lambda _: None,
) -> None:
    """Serve until `stop`; announce port, departure and arrival on stdout, and what was emitted at the end.

    car: is told when the car will set out (ns of the monotonic clock) once that is known, and None at first.
    """
    clock = RunClock()
    car(None)
    shared = False
    emulator = RplidarEmulator(model, ranger)
    with PtyPort(emulator, model.baud, link=link) as port:
        address = str(link) if link is not None else port.name
        _announce(as_json, "ready", address=address, model=model.name, baud=model.baud, drive=drive.name)
        departed = arrived = False
        while not stop.wait(_POLL_S):
            start_ns = ranger.start_ns
            if start_ns is None:
                continue
            if not shared:
                car(start_ns)
                shared = True
            if not departed and clock.monotonic_ns() >= start_ns:
                departed = True
                _announce(as_json, "departed", seconds=round(drive.duration_s, 1))
            if not arrived and clock.monotonic_ns() >= start_ns + drive.duration_s * 1e9:
                arrived = True
                _announce(as_json, "arrived")
    if truth is not None and ranger.start_ns is not None:
        shift_ns = ranger.start_ns + clock.offset_ns - int(drive.truth.stamps_ns[0])
        with writing_to(truth):
            write_tum(truth, replace(drive.truth, stamps_ns=drive.truth.stamps_ns + shift_ns))
    counters = emulator.counters
    _announce(as_json, "stopped", samples_emitted=counters.samples_emitted, bytes_lost=port.bytes_lost)


def car_writer(path: Path | None, world: str, drive: Drive) -> Callable[[int | None], None]:
    """Return what shares the car with its camera through a file, or does nothing without one."""
    if Path(world).is_file():
        world = str(Path(world).absolute())

    def share(start_ns: int | None) -> None:
        if path is not None:
            with writing_to(path):
                EmulatedCar(world, drive.truth, start_ns).write(path)

    return share


def _announce(as_json: bool, event: str, **details: object) -> None:
    """Print one event as one line."""
    if as_json:
        text = json.dumps({"event": event, **details})
    else:
        text = "  ".join([event, *(f"{key} {value}" for key, value in details.items())])
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
