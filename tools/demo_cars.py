"""Two emulated cars that are mapped live at once, each by a `run` of its own; whatever happens, no process is left."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.demo_processes import PATIENCE_S, Stopped, command_processes
from tools.errors import ToolError


@dataclass(frozen=True, slots=True)
class DemoCar:
    """One car of the demo: name, emulated lidar, drive (see `emulate lidar --drive`), cell size of its map.

    motor_pwm sets how fast its lidar turns: 660 is 10 turns a second.
    """

    name: str
    model: str
    drive: str
    resolution_m: float
    motor_pwm: int = 660


@dataclass(frozen=True, slots=True)
class CarFiles:
    """Where a car keeps what it makes; nothing but the scorer reads the truth."""

    folder: Path

    @property
    def config(self) -> Path:
        """The car's own settings."""
        return self.folder / "config.yaml"

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
            ends = ["--link", str(files.folder / "lidar"), "--truth", str(files.truth)]
            emulators.append(start(f"car {car.name}: emulate lidar", ["emulate", "lidar", *arguments, *ends]))
        for emulator, (car, files) in zip(emulators, cars, strict=True):
            emulator.event("ready", PATIENCE_S, (), stopped)
            files.config.write_text(f"lidar: {{motor_pwm: {car.motor_pwm}}}\n", encoding="utf-8")
            options = ["--lidar", str(files.folder / "lidar"), "--config", str(files.config)]
            options += ["--resolution", str(car.resolution_m), "-o", str(files.live)]
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
            if run.wait(PATIENCE_S, stopped) != 0:
                raise ToolError(f"{run.name} failed with exit code {run.code}: see above")
            emulator.interrupt()
        return [
            int(str(emulator.event("stopped", PATIENCE_S, (), stopped)["samples_emitted"])) for emulator in emulators
        ]
