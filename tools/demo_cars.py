"""Two emulated cars that are mapped live at once, each by a `run` of its own; whatever happens, no process is left."""

from __future__ import annotations

import json
import queue
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tools.errors import ToolError

# The package is found beside this file even where the current folder has one called `tools` too.
_PROGRAM = f"import sys; sys.path.insert(0, {str(Path(__file__).resolve().parent.parent)!r})"
_ENTRY = f"{_PROGRAM}; from tools.cli import main; main()"
_POLL_S = 0.1
_PATIENCE_S = 300.0  # for each step of starting up, and for saving: a small computer compiles what is compiled first
_GRACE_S = 20.0
Stopped = Callable[[], bool]


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


class _Process:
    """A command of this program as a process, and its JSON events."""

    def __init__(self, name: str, arguments: Sequence[str]) -> None:
        self.name = name
        command = [sys.executable, "-c", _ENTRY, *arguments]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)  # noqa: S603
        self._lines: queue.Queue[str] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def code(self) -> int | None:
        """The exit code; None while it runs."""
        return self._process.poll()

    def event(self, wanted: str, patience_s: float, watched: Sequence[_Process], stopped: Stopped) -> dict[str, object]:
        """Wait for an event; raises ToolError if it does not come, or a watched process ends before."""
        ends_at = time.monotonic() + patience_s
        while time.monotonic() < ends_at:
            _check(stopped)
            try:
                event: dict[str, object] = json.loads(self._lines.get(timeout=_POLL_S))
            except queue.Empty:
                for process in (self, *watched):
                    if process.code is not None and self._lines.empty():
                        raise ToolError(
                            f"{process.name} ended with exit code {process.code} before '{wanted}': see above"
                        ) from None
                continue
            if event["event"] == wanted:
                return event
        raise ToolError(f"{self.name}: no '{wanted}' within {patience_s:.0f} s")

    def interrupt(self) -> None:
        """Press Ctrl-C for it."""
        if self.code is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, patience_s: float, stopped: Stopped) -> int:
        """Wait for its end and return the exit code; raises ToolError if it takes too long."""
        ends_at = time.monotonic() + patience_s
        while self.code is None and time.monotonic() < ends_at:
            _check(stopped)
            time.sleep(_POLL_S)
        if self.code is None:
            raise ToolError(f"{self.name} did not end within {patience_s:.0f} s")
        return self.code

    def close(self) -> None:
        """End it, gently at first."""
        for end in (self._process.terminate, self._process.kill):
            if self.code is None:
                end()
                try:
                    self._process.wait(_GRACE_S)
                except subprocess.TimeoutExpired:
                    continue
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)


def run_command(stopped: Stopped, *arguments: str, allowed: Sequence[int] = (0,)) -> int:
    """Run a command of this program to its end and return its exit code; raises ToolError for one not allowed."""
    with _processes() as start:
        code = start(f"mapfuse-robot {arguments[0]}", arguments).wait(10 * _PATIENCE_S, stopped)
    if code not in allowed:
        raise ToolError(f"mapfuse-robot {arguments[0]} failed with exit code {code}: see above")
    return code


def drive_live(
    cars: Sequence[tuple[DemoCar, CarFiles]], seed: int, stopped: Stopped, say: Callable[[str], None]
) -> list[int]:
    """Emulate and map all cars at once until each has arrived; return the samples that each emulator emitted.

    stopped() tells that the user wants to end. Raises ToolError naming the process that failed, KeyboardInterrupt.
    """
    with _processes() as start:
        emulators, runs = [], []
        for number, (car, files) in enumerate(cars):
            arguments = ["--model", car.model, "--drive", car.drive, "--seed", str(2 * seed + number), "--json"]
            ends = ["--link", str(files.folder / "lidar"), "--truth", str(files.truth)]
            emulators.append(start(f"car {car.name}: emulate lidar", ["emulate", "lidar", *arguments, *ends]))
        for emulator, (car, files) in zip(emulators, cars, strict=True):
            emulator.event("ready", _PATIENCE_S, (), stopped)
            files.config.write_text(f"lidar: {{motor_pwm: {car.motor_pwm}}}\n", encoding="utf-8")
            options = ["--lidar", str(files.folder / "lidar"), "--config", str(files.config)]
            options += ["--resolution", str(car.resolution_m), "-o", str(files.live)]
            say(f"     car {car.name}: mapfuse-robot run {shlex.join(options)}")
            runs.append(start(f"car {car.name}: run", ["-q", "run", *options]))
        seconds = [
            float(str(emulator.event("departed", _PATIENCE_S, (run,), stopped)["seconds"]))
            for emulator, run in zip(emulators, runs, strict=True)
        ]
        say(f"     the cars drive for {max(seconds):.0f} s")
        for number, (emulator, run) in enumerate(zip(emulators, runs, strict=True)):
            emulator.event("arrived", max(seconds) + _PATIENCE_S, runs[number:], stopped)  # the others have ended
            run.interrupt()
            if run.wait(_PATIENCE_S, stopped) != 0:
                raise ToolError(f"{run.name} failed with exit code {run.code}: see above")
            emulator.interrupt()
        return [
            int(str(emulator.event("stopped", _PATIENCE_S, (), stopped)["samples_emitted"])) for emulator in emulators
        ]


@contextmanager
def _processes() -> Iterator[Callable[[str, Sequence[str]], _Process]]:
    """Yield a function that starts processes; all of them have ended when the block is left."""
    started: list[_Process] = []

    def start(name: str, arguments: Sequence[str]) -> _Process:
        started.append(_Process(name, arguments))
        return started[-1]

    try:
        yield start
    finally:
        for process in reversed(started):
            process.close()


def _check(stopped: Stopped) -> None:
    if stopped():
        raise KeyboardInterrupt
