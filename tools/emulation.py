"""An emulated car: its lidar on a pseudo-terminal, in a world, along a drive."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.emulated_faults import FaultError, FaultKind, FaultScript, parse_fault, parse_script
from drivers.faulty_line import FaultyLine
from drivers.pty_port import PtyPort
from drivers.rplidar_emulated_scan import Ranger
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import EmulatedModel
from mapping.trajectory import Trajectory, read_tum, write_tum
from tools.announcement import announce
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


def with_firmware(model: EmulatedModel, firmware: str | None) -> EmulatedModel:
    """Return the model with the firmware of the command line, such as 1.20; raises UsageError."""
    if firmware is None:
        return model
    major, dot, minor = firmware.partition(".")
    if not (dot and major.isdecimal() and minor.isdecimal() and int(major) < 256 and int(minor) < 256):
        raise UsageError(f"--firmware {firmware}: expected major and minor, such as 1.20")
    return model.with_firmware((int(major), int(minor)))


def read_faults(faults: Sequence[str], file: Path | None, seed: int) -> FaultScript:
    """Return the script of the command line and of a file; raises UsageError."""
    try:
        scripted = () if file is None else parse_script(file.read_text(encoding="utf-8"))
        return FaultScript((*scripted, *map(parse_fault, faults)), seed)
    except FaultError as error:
        raise UsageError(str(error)) from error
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--faults {file}: cannot be read as text ({error})") from error


class EmulatedSensor:
    """An RPLIDAR on a pseudo-terminal with the faults of a script: what `emulate lidar` serves."""

    def __init__(
        self,
        model: EmulatedModel,
        ranger: Ranger,
        *,
        board: bool = True,
        script: FaultScript | None = None,
        link: Path | None = None,
        clock: Callable[[], int] = RunClock.monotonic_ns,
    ) -> None:
        self._clock = clock
        self._script = script or FaultScript()
        self.emulator = RplidarEmulator(model, ranger, board=board, script=self._script)
        self._line = FaultyLine(self.emulator, self._script, model.baud)
        self._link = link
        self.port = PtyPort(self._line, model.baud, link=link, clock=clock)
        self._plugged = True

    @property
    def address(self) -> str:
        """What to open."""
        return str(self._link) if self._link is not None else self.port.name

    def follow_script(self) -> str | None:
        """Pull the plug or put it back where it is time; return what was done, `unplugged` or `plugged`."""
        now_ns = self._clock()
        wanted = self._script.active(FaultKind.UNPLUG, now_ns) is None
        if wanted == self._plugged:
            return None
        self._plugged = wanted
        if not wanted:
            self.port.unplug()
            return "unplugged"
        self._line.power_up(now_ns)
        self.port.plug_in()
        return "plugged"


def serve_lidar(
    sensor: EmulatedSensor,
    ranger: SimulatedLidar,
    drive: Drive,
    stop: threading.Event,
    *,
    truth: Path | None,
    as_json: bool,
    car: Callable[[int | None], None] = lambda _: None,
) -> None:
    """Serve until `stop`; announce port, departure and arrival on stdout, and what was emitted at the end.

    car: is told when the car will set out (ns of the monotonic clock) once that is known, and None at first.
    """
    clock = RunClock()
    car(None)
    model = sensor.emulator.model
    with sensor.port:
        announce(as_json, "ready", address=sensor.address, model=model.name, baud=model.baud, drive=drive.name)
        waiting = [(0.0, "departed"), (drive.duration_s, "arrived")]
        shared = False
        while not stop.wait(_POLL_S):
            event = sensor.follow_script()
            if event is not None:
                announce(as_json, event, address=sensor.address)
            start_ns = ranger.start_ns
            if start_ns is None:
                continue
            if not shared:
                car(start_ns)
                shared = True
            while waiting and clock.monotonic_ns() >= start_ns + waiting[0][0] * 1e9:
                _, name = waiting.pop(0)
                announce(as_json, name, **({"seconds": round(drive.duration_s, 1)} if name == "departed" else {}))
    if truth is not None and ranger.start_ns is not None:
        shift_ns = ranger.start_ns + clock.offset_ns - int(drive.truth.stamps_ns[0])
        with writing_to(truth):
            write_tum(truth, replace(drive.truth, stamps_ns=drive.truth.stamps_ns + shift_ns))
    counters = sensor.emulator.counters
    announce(as_json, "stopped", samples_emitted=counters.samples_emitted, bytes_lost=sensor.port.bytes_lost)


def car_writer(path: Path | None, world: str, drive: Drive) -> Callable[[int | None], None]:
    """Return what shares the car with its camera through a file, or does nothing without one."""
    if Path(world).is_file():
        world = str(Path(world).absolute())

    def share(start_ns: int | None) -> None:
        if path is not None:
            with writing_to(path):
                EmulatedCar(world, drive.truth, start_ns).write(path)

    return share
