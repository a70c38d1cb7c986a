"""What stops a QCar's motor, shown by the process that owns the board, on a fake of Quanser's API in real time."""

import ast
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drivers import qcar_guard
from drivers.vehicle import LostVehicleError
from tests.drivers.fake_qcar import DEADLINE_S, FAKE_API

LATE_S = 0.2  # what a busy computer may add

# Drives as a program does, and tells the number of the process that owns the board.
DRIVING = f"""
import sys, time
from drivers.qcar_link import GuardedBoard
from drivers.qcar_vehicle import QcarVehicle
from drivers.vehicle import DriveCommand
board = GuardedBoard({DEADLINE_S}, 0.3, api="{FAKE_API}")
with QcarVehicle(time.monotonic_ns, board=lambda: board) as car:
    car.arm()
    begun = time.monotonic()
    while True:
        car.drive(DriveCommand(0.5, 0.0))
        car.poll()
        if begun and time.monotonic() - begun > 0.5:
            begun = 0.0
            print(board.pid, flush=True)
        time.sleep(0.02)
"""


@pytest.fixture
def driving(qcar_writes):
    """A program that drives, in a process of its own, and the number of the one that owns the board."""
    process = subprocess.Popen([sys.executable, "-c", DRIVING], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    yield process, int(process.stdout.readline())
    process.kill()
    process.communicate()


def await_end(pid: int, limit_s: float) -> None:
    """Wait until a process that is not our child is gone."""
    ends = time.monotonic() + limit_s
    while Path(f"/proc/{pid}").exists() and "Z" not in Path(f"/proc/{pid}/stat").read_text().split(") ")[1][:1]:
        assert time.monotonic() < ends, f"process {pid} still runs"
        time.sleep(0.01)


def standstill_after(written: list[tuple[float, str]], event_s: float) -> float:
    """Seconds from the event to the first zero throttle after which none other came."""
    last_driven = max(n for n, (_, what) in enumerate(written) if what not in {"0.0", "terminated"})
    return written[last_driven + 1][0] - event_s


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])
def test_the_motor_stands_at_once_when_its_program_is_killed(driving, qcar_writes, number) -> None:
    process, guard = driving
    killed = time.monotonic()
    process.send_signal(number)
    process.wait()
    await_end(guard, 2.0)
    assert standstill_after(qcar_writes(), killed) < LATE_S
    assert qcar_writes()[-1][1] == "terminated"


def test_the_motor_stands_after_the_deadline_when_its_program_is_stuck(driving, qcar_writes) -> None:
    process, _ = driving
    stopped = time.monotonic()
    process.send_signal(signal.SIGSTOP)
    time.sleep(DEADLINE_S + LATE_S + 0.1)
    after_s = standstill_after(qcar_writes(), stopped)
    assert DEADLINE_S - 0.1 < after_s < DEADLINE_S + LATE_S
    process.send_signal(signal.SIGCONT)
    time.sleep(0.5)
    assert float(qcar_writes()[-1][1]) > 0.0  # it goes on where its program does


def test_a_child_that_holds_the_socket_open_does_not_hold_the_motor(qcar_writes) -> None:
    """A fork without exec inherits it, so that nothing tells the guard of its program's end but the parent's number."""
    program = DRIVING.replace(
        "with Qcar", "import os\nif os.fork() == 0:\n    time.sleep(5)\n    os._exit(0)\nwith Qcar"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        guard = int(process.stdout.readline())
        killed = time.monotonic()
        process.kill()
        process.stdout.close()
        await_end(guard, 2.0)
    assert standstill_after(qcar_writes(), killed) < LATE_S


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_the_guard_itself_leaves_the_motor_standing_when_asked_to_end(qcar_board, qcar_writes, number) -> None:
    qcar_board.write(0.2, 0.0)
    qcar_board.read()
    os.kill(qcar_board.pid, number)
    if number == signal.SIGTERM:
        await_end(qcar_board.pid, 2.0)
        assert [what for _, what in qcar_writes()][-2:] == ["0.0", "terminated"]
        with pytest.raises(LostVehicleError, match="has ended"):
            qcar_board.read()
    else:  # the terminal's, which are for its parent
        qcar_board.read()


def test_the_guard_is_a_program_for_the_older_python_of_a_car() -> None:
    """Syntax of Python 3.6 and its standard library; whether it runs there is to be seen on the car."""
    source = Path(qcar_guard.__file__).read_text()
    tree = ast.parse(source, feature_version=(3, 6))
    imported = {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= {*sys.stdlib_module_names, "collections.abc"} - {"__future__", "contextvars", "dataclasses"}


def test_a_throttle_beyond_the_limit_is_cut_and_standstill_needs_no_deadline(qcar_board, qcar_writes) -> None:
    qcar_board.write(5.0, 0.0)
    qcar_board.write(0.0, 0.0)
    time.sleep(DEADLINE_S + LATE_S)
    qcar_board.read()
    assert [what for _, what in qcar_writes()] == ["0.3", "0.0"]
