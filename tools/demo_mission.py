"""The demo: an emulated car is mapped live over a pseudo-terminal, the recording replayed, both scored on the truth."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import typer

from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import read_tum
from tools.errors import ToolError

_MARK = "demo.json"  # tells a folder that a former demo made, which may be emptied


@dataclass(frozen=True, slots=True)
class DemoFiles:
    """Where the demo keeps what it makes."""

    folder: Path

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
        """The simulator's true drive: nothing but the scorer reads it."""
        return self.folder / "truth.tum"

    @property
    def picture(self) -> Path:
        """Map, trajectory and truth in one picture."""
        return self.folder / "demo.png"


def run_demo(folder: Path, model: str, seed: int) -> None:
    """Run the mission, print the table and write the picture. Raises ToolError naming the part that failed."""
    files = DemoFiles(folder)
    _clear(files)
    _say("1/4  an emulated car with an RPLIDAR sets out (simulated data)")
    emitted = _drive_live(files, model, seed)
    _say("3/4  the recording is replayed")
    _command("replay", str(files.live / "recording.mcap"), "-o", str(files.replay))
    _say("4/4  the trajectory is scored against the simulator's truth")
    _score(files, emitted)


def _drive_live(files: DemoFiles, model: str, seed: int) -> int:
    """Emulate and map until the car has arrived; return the number of samples that the emulator emitted."""
    link = files.folder / "lidar"
    arguments = ["emulate", "lidar", "--model", model, "--seed", str(seed), "--json"]
    emulator = _start(*arguments, "--link", str(link), "--truth", str(files.truth), stdout=subprocess.PIPE)
    run: subprocess.Popen[str] | None = None
    try:
        assert emulator.stdout is not None
        _await_event(emulator.stdout, "ready")
        _say(f"2/4  mapfuse-robot run --lidar {link}")
        run = _start("run", "--lidar", str(link), "-o", str(files.live))
        departed = _await_event(emulator.stdout, "departed")
        _say(f"     the car drives for {departed['seconds']} s")
        _await_event(emulator.stdout, "arrived")
        _end(run, "run")
        _end(emulator, "emulate lidar", wait=False)
        return int(str(_await_event(emulator.stdout, "stopped")["samples_emitted"]))
    finally:
        for process in (run, emulator):
            if process is not None and process.poll() is None:
                process.terminate()
                process.wait()


def _score(files: DemoFiles, emitted: int) -> None:
    """Compare live run, replay and truth; print the table; draw the picture."""
    from tools.plots import draw_demo

    truth, live, replayed = (read_tum(path) for path in _trajectories(files))
    report = json.loads((files.live / "report.json").read_text(encoding="utf-8"))
    identical = _same(files)
    error = absolute_trajectory_error(live, truth)
    draw_demo(files.picture, read_map(files.live / "map.npz"), live, truth, error)
    decoded = report["decoder"]["samples"]
    rows = [
        ("driven", f"{truth.length_m:.1f} m in {(truth.stamps_ns[-1] - truth.stamps_ns[0]) * 1e-9:.0f} s"),
        ("points decoded / emitted", f"{decoded} / {emitted} ({decoded / emitted:.2%})"),
        ("scans mapped / dropped", f"{report['scans']['mapped']} / {report['dropped_scans']}"),
        ("mapping time a scan", f"{report['timing']['per_scan_ms_median']:.1f} ms (median)"),
        ("trajectory error, rms", f"{error.rms_m * 100:.1f} cm"),
        ("trajectory error, max", f"{error.max_m * 100:.1f} cm, {error.max_deg:.2f} deg"),
        ("replay = live run", "identical trajectory and map" if identical else f"DIFFERENT ({len(replayed)} poses)"),
        ("picture", str(files.picture)),
    ]
    width = max(len(name) for name, _ in rows)
    _say("\nSimulated data:\n" + "\n".join(f"  {name:<{width}}  {value}" for name, value in rows))
    values = {"rms_m": error.rms_m, "max_m": error.max_m, "max_deg": error.max_deg, "identical": identical}
    (files.folder / _MARK).write_text(json.dumps(values | {"decoded": decoded, "emitted": emitted}) + "\n")
    if not identical:
        raise ToolError(f"{files.folder}: the replay differs from the live run")


def _trajectories(files: DemoFiles) -> tuple[Path, Path, Path]:
    return files.truth, files.live / "trajectory.tum", files.replay / "trajectory.tum"


def _same(files: DemoFiles) -> bool:
    """Whether live run and replay gave the same bytes."""
    names = ("trajectory.tum", "map.pgm", "map.yaml")
    return all((files.live / name).read_bytes() == (files.replay / name).read_bytes() for name in names)


def _clear(files: DemoFiles) -> None:
    """Make the folder; empty it only if a former demo made it."""
    if files.folder.exists() and any(files.folder.iterdir()):
        if not (files.folder / _MARK).exists():
            raise ToolError(f"{files.folder}: not empty, and no former demo's folder: choose another with -o")
        shutil.rmtree(files.folder)
    files.folder.mkdir(parents=True, exist_ok=True)
    (files.folder / _MARK).write_text("{}\n")


def _await_event(stream: IO[str], wanted: str) -> dict[str, object]:
    """Read the emulator's events up to the wanted one."""
    for line in stream:
        event: dict[str, object] = json.loads(line)
        if event["event"] == wanted:
            return event
    raise ToolError(f"the emulator ended before it was '{wanted}'")


def _start(*arguments: str, stdout: int | None = None) -> subprocess.Popen[str]:
    """Start a command of this program as a process of its own."""
    return subprocess.Popen([sys.executable, "-m", "tools.cli", *arguments], stdout=stdout, text=True)  # noqa: S603


def _command(*arguments: str) -> None:
    """Run a command of this program to its end."""
    process = _start(*arguments)
    if process.wait() != 0:
        raise ToolError(f"mapfuse-robot {arguments[0]} failed with exit code {process.returncode}")


def _end(process: subprocess.Popen[str], name: str, *, wait: bool = True) -> None:
    """Press Ctrl-C for a process."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    if wait and process.wait() != 0:
        raise ToolError(f"mapfuse-robot {name} failed with exit code {process.returncode}")


def _say(text: str) -> None:
    typer.echo(text, err=True)
