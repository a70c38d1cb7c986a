"""`evaluate drives --live`: `run` drives an emulated car in real time, over a pseudo-terminal and UDP, and is stopped.

The emulated car is in this process, so that what happens to it and when is known to the millisecond; `run` is in one of
its own, as on a car, where it can be killed. All of it is simulated, in real time.
"""

from __future__ import annotations

import json
import math
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.rover_dynamics import RoverModel
from mapping import se2
from mapping.map_io import write_map
from tools.drive_bench import WORLD, Bench, Case, map_world
from tools.drive_scores import Stop, arrival
from tools.drive_stops import STOP_S, TIMEOUT_S, or_none, told_stop
from tools.errors import ToolError
from tools.processes import own_command
from tools.results import Report
from tools.watched_car import WatchedCar

FloatArray = NDArray[np.float64]
_START_S, _DRIVE_S, _END_S = 240.0, 120.0, 60.0  # a computer that compiles first; the longest way; saving
_STOP_AFTER_S = 2.5  # of driving fast, at most
_STANDS_S = 1.0
_TURN_S = 0.05  # of the emulator's own loop
_FIRST_CASE = 5000


class LiveCause(str, Enum):
    """What becomes of a drive."""

    arrival = "arrival"
    interrupt = "Ctrl-C"
    emergency = "e-stop"
    silent_lidar = "silent lidar"
    blind_lidar = "blind lidar"  # scans come, and give no pose
    killed = "SIGKILL"
    cut = "link cut"


MAPS_ON = (LiveCause.emergency, LiveCause.blind_lidar, LiveCause.cut)  # `run`, until somebody ends it
BY_TIMEOUT = (LiveCause.killed, LiveCause.cut)  # where nobody but the vehicle can stop it


def in_time(stop: Stop, cause: LiveCause, timeout_s: float, model: RoverModel) -> bool:
    """Whether the car stood as soon as it must: 0.6 s or the vehicle's timeout + 0.1 s, and braking."""
    if cause in BY_TIMEOUT:
        return stop.by_timeout(timeout_s + TIMEOUT_S, model, _TURN_S)
    return stop.in_time(STOP_S, model, _TURN_S)


@contextmanager
def _running(arguments: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a command of this program, with its lines in a file; whatever happens, it is not left behind."""
    with log.open("wb") as lines:
        process = subprocess.Popen(  # noqa: S603 - our own program
            own_command(arguments), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=lines
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def live_trial(case: Case, cause: LiveCause, map_file: Path, folder: Path) -> Report:
    """Have `run` drive from start to goal of a case, or be stopped on the way at an instant by chance; score it.

    folder is made. Raises ToolError where the drive does not begin.
    """
    folder.mkdir()
    bench = case.bench
    random = np.random.default_rng([bench.seed, case.number, 77])
    world_pose = se2.compose(bench.mapped.T_world_map, case.start)
    car = WatchedCar(WORLD, world_pose, folder / "lidar", bench.seed * 10_000 + case.number)
    arguments = ["run", "--lidar", str(folder / "lidar"), "--map", str(map_file), "--vehicle", car.address]
    arguments += ["--goal", *map(str, case.goal.tolist()), "--start", *map(str, case.told.tolist())]
    arguments += ["-o", str(folder / "run")]
    lines = folder / "log.txt"
    try:
        with _running(arguments, lines) as process:
            _wait(lambda: car.is_driven, _START_S, process, lines)
            event_ns = None
            if cause is not LiveCause.arrival:
                time.sleep(random.uniform(0.0, _STOP_AFTER_S))
                _wait(lambda: car.is_driven, _DRIVE_S, process, lines)
                event_ns = car.now_ns()
                _happen(cause, car, process)
            code = _ended(process, car, wants_signal=cause in MAPS_ON)
    finally:
        car.close()
    return _row(case, cause, car, event_ns, code, folder)


def _happen(cause: LiveCause, car: WatchedCar, process: subprocess.Popen[bytes]) -> None:
    if cause is LiveCause.silent_lidar:
        car.silence_lidar()
    elif cause is LiveCause.blind_lidar:
        car.blind_lidar()
    elif cause is LiveCause.cut:
        car.cut_link()
    else:
        numbers = {LiveCause.interrupt: signal.SIGINT, LiveCause.emergency: signal.SIGUSR1}
        process.send_signal(numbers.get(cause, signal.SIGKILL))


def _wait(reached: Callable[[], bool], seconds: float, process: subprocess.Popen[bytes], lines: Path) -> None:
    """Wait until it is reached; raises ToolError with the last lines of `run` if it is not."""
    ends_s = time.monotonic() + seconds
    while not reached():
        if process.poll() is not None or time.monotonic() > ends_s:
            last = " | ".join(lines.read_text(encoding="utf-8", errors="replace").splitlines()[-5:])
            raise ToolError(f"the live drive does not begin or go on (exit code {process.poll()}): {last}")
        time.sleep(0.005)


def _ended(process: subprocess.Popen[bytes], car: WatchedCar, *, wants_signal: bool) -> int:
    """Wait until the car has stood for a while and `run` has ended, which it must be asked to where it maps on."""
    ends_s = time.monotonic() + _DRIVE_S
    stood_s = time.monotonic()
    while time.monotonic() < ends_s:
        if not car.stands:
            stood_s = time.monotonic()
        stands = time.monotonic() - stood_s > _STANDS_S
        if stands and wants_signal and process.poll() is None:
            process.send_signal(signal.SIGINT)
            wants_signal = False
        if stands and process.poll() is not None:
            return process.returncode
        time.sleep(0.01)
    return process.wait(_END_S)


def _row(case: Case, cause: LiveCause, car: WatchedCar, event_ns: int | None, code: int, folder: Path) -> Report:
    """Return what is reported of a trial."""
    rover, bench = car.emulated.rover, case.bench
    stamps_ns, poses, _ = car.emulated.world.truth
    end = arrival(se2.compose(se2.inverse(bench.mapped.T_world_map), poses[-1]), case.goal)
    timeout_s = rover.autopilot.parameters["GUID_TIMEOUT"]
    report_file = folder / "run" / "report.json"
    report = json.loads(report_file.read_text(encoding="utf-8")) if report_file.exists() else {}
    row: Report = {
        "cause": cause.value,
        "code": code,
        "contacts": rover.contacts,
        "seconds": round(float(stamps_ns[-1] - stamps_ns[0]) * 1e-9, 1),
        "waited_s": round(car.emulated.clock.waited_s, 2),
        "saved": bool(report),
        "thread": report.get("drive", {}).get("thread"),
        "stops": [stop["reason"] for stop in report.get("drive", {}).get("stops", ())],
    }
    if event_ns is None:
        row |= {"goal_m": round(end.away_m, 4), "goal_deg": round(math.degrees(end.turned_rad), 2)}
        row["passed"] = code == 0 and end.is_within() and not rover.contacts
        return row
    stop = car.stop_after(event_ns)
    row |= {
        "command_s": or_none(stop.command_s),
        "stood_s": or_none(stop.stood_s),
        "speed_mps": round(stop.event_mps, 3),
        "vehicle_timeout_s": timeout_s,
        "in_time": in_time(stop, cause, timeout_s, bench.model),
    }
    is_saved = bool(report) or cause is LiveCause.killed
    is_blind = cause in BY_TIMEOUT  # until its timeout it drives on as it was told last, and a wall may be in the way
    row["passed"] = row["in_time"] and is_saved and (is_blind or not rover.contacts)
    return row


def evaluate_live(count: int, seed: int, folder: Path, say: Callable[[str], None]) -> Report:
    """Map the world, then make so many trials of each cause; folder: for the map and for what `run` leaves."""
    bench = Bench(map_world(seed), seed)
    write_map(folder / "office", bench.mapped.grid, provenance={"source": "simulated"})
    rows = []
    for kind, cause in enumerate(LiveCause):
        for number in range(count):
            case = bench.case(_FIRST_CASE + 100 * kind + number)
            row = live_trial(case, cause, folder / "office.yaml", folder / f"{cause.name}_{number}")
            rows.append(row)
            say(_words(row))
    return {"simulated": True, "each": count, "rows": rows, "passed": all(row["passed"] for row in rows)}


def table_of_live(report: Report) -> list[str]:
    """Return the table that the command prints."""
    lines = [
        f"in real time, `run` over a pseudo-terminal and UDP (emulated car, simulated world), {report['each']} each:"
    ]
    for cause in LiveCause:
        rows = [row for row in report["rows"] if row["cause"] == cause.value]
        passed = sum(row["passed"] for row in rows)
        if cause is LiveCause.arrival:
            worst = (
                f"{max(row['goal_m'] for row in rows) * 100:.1f} cm, {max(row['goal_deg'] for row in rows):.1f} deg off"
            )
        else:
            zeros = [row["command_s"] for row in rows if row["command_s"] is not None]
            stood = max((math.inf if row["stood_s"] is None else row["stood_s"]) for row in rows)
            zero = f"zero speed after {max(zeros):.3f} s, " if zeros and cause not in BY_TIMEOUT else ""
            worst = f"{zero}standing after {stood:.2f} s"
        contacts = sum(row["contacts"] for row in rows)
        lines.append(f"  {cause.value:<13} {passed} of {len(rows)}; at most {worst}; {contacts} contacts")
    return lines


def _words(row: Report) -> str:
    is_arrival = row["cause"] == LiveCause.arrival.value
    what = f"{row['goal_m'] * 100:.1f} cm and {row['goal_deg']:.1f} deg off" if is_arrival else told_stop(row)
    good = "passed" if row["passed"] else "FAILED"
    return f"live, {row['cause']}: {what}, exit code {row['code']}, {row['contacts']} contacts: {good}"
