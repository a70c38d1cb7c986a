"""Two emulated cars that are mapped live at once, each by a `run` of its own; whatever happens, no process is left."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from tools.demo_processes import PATIENCE_S, CommandProcess, Stopped, command_processes
from tools.emulation import Drive
from tools.errors import ToolError
from tools.world import TOURS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DemoCar:
    """One car of the demo: name, emulated lidar, drive (see `emulate lidar --drive`), cell size of its map.

    motor_pwm sets how fast its lidar turns: 660 is 10 turns a second. goals: poses (x, y, yaw) in the world along the
    same way, for a car that drives itself.
    """

    name: str
    model: str
    drive: str
    resolution_m: float
    motor_pwm: int = 660
    goals: tuple[tuple[float, float, float], ...] = ()

    @property
    def start(self) -> FloatArray:
        """Where in the world (3,) it starts."""
        start: FloatArray = Drive.tour(self.drive).truth.poses[0]
        return start


_GOALS_A = ((2.2, 6.9, 1.57), (6.3, 9.6, 0.0), (11.3, 6.3, 0.3))
_GOALS_B = ((14.4, 10.2, 1.0), (16.1, 6.8, -1.6), (10.0, 5.9, 3.0))
CARS = (
    DemoCar("A", "A2M8", "wings-west", 0.04, goals=_GOALS_A),
    DemoCar("B", "A2M12", "wings-east", 0.05, motor_pwm=792, goals=_GOALS_B),
)


@dataclass(frozen=True, slots=True)
class CarFiles:
    """Where a car keeps what it makes; nothing but the scorer reads the truth."""

    folder: Path

    @property
    def config(self) -> Path:
        """The car's own settings."""
        return self.folder / "config.yaml"

    @property
    def lidar(self) -> Path:
        """The port of its emulated lidar."""
        return self.folder / "lidar"

    @property
    def live(self) -> Path:
        """Results and recording of the live run."""
        return self.folder / "live"

    @property
    def replay(self) -> Path:
        """Results of the replay."""
        return self.folder / "replay"

    @property
    def truth(self) -> Path:
        """The simulator's true drive."""
        return self.folder / "truth.tum"


MapLive = Callable[[Sequence[tuple[DemoCar, CarFiles]], int, Stopped, Callable[[str], None]], list[int]]


def drive_live(
    cars: Sequence[tuple[DemoCar, CarFiles]], seed: int, stopped: Stopped, say: Callable[[str], None]
) -> list[int]:
    """Emulate and map all cars at once until each has arrived; return the samples that each emulator emitted.

    stopped() tells that the user wants to end. Raises ToolError naming the process that failed, KeyboardInterrupt.
    """
    with command_processes() as start:
        emulators, runs = [], []
        for number, (car, files) in enumerate(cars):
            arguments = ["--model", car.model, "--drive", car.drive, "--seed", str(2 * seed + number), "--json"]
            ends = ["--link", str(files.lidar), "--truth", str(files.truth)]
            emulators.append(start(f"car {car.name}: emulate lidar", ["emulate", "lidar", *arguments, *ends]))
        for emulator, (car, files) in zip(emulators, cars, strict=True):
            emulator.event("ready", PATIENCE_S, (), stopped)
            options = _run_options(car, files)
            say(f"     car {car.name}: mapfuse-robot run {shlex.join(options)}")
            runs.append(start(f"car {car.name}: run", ["-q", "run", *options]))
        seconds = [
            float(str(emulator.event("departed", PATIENCE_S, (run,), stopped)["seconds"]))
            for emulator, run in zip(emulators, runs, strict=True)
        ]
        say(f"     the cars drive for {max(seconds):.0f} s")
        for number, (emulator, run) in enumerate(zip(emulators, runs, strict=True)):
            emulator.event("arrived", max(seconds) + PATIENCE_S, runs[number:], stopped)  # the others have ended
            run.interrupt()
            _end(run, emulator, stopped)
        return [_emitted(emulator, stopped) for emulator in emulators]


def explore_live(
    cars: Sequence[tuple[DemoCar, CarFiles]], seed: int, stopped: Stopped, say: Callable[[str], None]
) -> list[int]:
    """The same, but the cars drive themselves to their goals, on the maps that they are making."""
    with command_processes() as start:
        emulators, runs = [], []
        for number, (car, files) in enumerate(cars):
            pose = _words(car.start)
            place = [
                "--world",
                TOURS[car.drive][0],
                "--pose",
                *pose,
                "--model",
                car.model,
                "--rover",
                "udp:127.0.0.1:0",
            ]
            ends = ["--lidar-link", str(files.lidar), "--truth", str(files.truth), "--seed", str(2 * seed + number)]
            emulators.append(start(f"car {car.name}: emulate car", ["emulate", "car", *place, *ends, "--json"]))
        for emulator, (car, files) in zip(emulators, cars, strict=True):
            vehicle = str(emulator.event("ready", PATIENCE_S, (), stopped)["vehicle"])
            options = [*_run_options(car, files), "--vehicle", vehicle]
            for goal in car.goals:  # on the car's own map, which begins where it starts
                options += ["--goal", *_words(se2.between(car.start, np.array(goal)))]
            say(f"     car {car.name}: mapfuse-robot run {shlex.join(options)}")
            runs.append(start(f"car {car.name}: run", ["-q", "run", *options]))
        for emulator, run in zip(emulators, runs, strict=True):
            _end(run, emulator, stopped)
        return [_emitted(emulator, stopped) for emulator in emulators]


def _run_options(car: DemoCar, files: CarFiles) -> list[str]:
    """Write the car's settings and return what `run` maps it with."""
    files.config.write_text(f"lidar: {{motor_pwm: {car.motor_pwm}}}\n", encoding="utf-8")
    options = ["--lidar", str(files.lidar), "--config", str(files.config)]
    return [*options, "--resolution", str(car.resolution_m), "-o", str(files.live)]


def _end(run: CommandProcess, emulator: CommandProcess, stopped: Stopped) -> None:
    """Wait for a run's end, and end what it mapped; raises ToolError for a run that failed."""
    if run.wait(PATIENCE_S, stopped) != 0:
        raise ToolError(f"{run.name} failed with exit code {run.code}: see above")
    emulator.interrupt()


def _emitted(emulator: CommandProcess, stopped: Stopped) -> int:
    return int(str(emulator.event("stopped", PATIENCE_S, (), stopped)["samples_emitted"]))


def _words(pose: FloatArray) -> list[str]:
    return [f"{round(value, 4) + 0.0:.4f}" for value in pose.tolist()]  # no -0.0000
