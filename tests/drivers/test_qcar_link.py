"""The link to the process that owns a QCar's board, on a fake of Quanser's API in real time."""

import os
import signal
import time
from pathlib import Path

import pytest

from drivers.errors import DriverError, SilentPortError
from drivers.qcar_link import GuardedBoard
from drivers.qcar_vehicle import QcarSettings, QcarVehicle
from drivers.vehicle import DriveCommand, LostVehicleError
from tests.drivers.fake_qcar import DEADLINE_S, FAKE_API


def test_the_board_answers_as_if_it_were_here(qcar_board) -> None:
    qcar_board.write(0.2, 0.3)
    time.sleep(0.3)
    qcar_board.read()
    assert qcar_board.batteryVoltage == 12.0
    assert qcar_board.motorEncoder[0] > 1000
    assert qcar_board.gyroscope[2] > 0.05
    assert qcar_board.accelerometer.tolist() == [0.0, 0.0, 9.81]


def test_a_stuck_guard_is_told(qcar_board) -> None:
    os.kill(qcar_board.pid, signal.SIGSTOP)
    try:
        with pytest.raises(LostVehicleError, match="has not answered"):
            qcar_board.read()
    finally:
        os.kill(qcar_board.pid, signal.SIGCONT)
    qcar_board.read()  # the late answer to the first question is not taken for this one's


def test_a_vehicle_keeps_the_deadline_of_its_guard_and_tells_what_is_missing() -> None:
    car = QcarVehicle(time.monotonic_ns, settings=QcarSettings(command_life_s=0.4))
    assert car.setpoint_timeout_s == 0.4
    with pytest.raises(DriverError, match=r"Quanser's Python API is missing in .* run on the car"), car:
        pass
    with pytest.raises(DriverError, match="cannot be started"):
        GuardedBoard(DEADLINE_S, 0.3, python="/no/such/python")


def test_a_board_without_a_battery_is_refused_and_its_process_ends(qcar_writes, monkeypatch) -> None:
    monkeypatch.setenv("FAKE_QCAR_VOLTS", "0")
    boards: list[GuardedBoard] = []

    def opened() -> GuardedBoard:
        boards.append(GuardedBoard(DEADLINE_S, 0.3, api=FAKE_API))
        return boards[-1]

    with pytest.raises(SilentPortError, match="0 V"), QcarVehicle(time.monotonic_ns, board=opened):
        pass
    assert not Path(f"/proc/{boards[0].pid}").exists()


def test_a_vehicle_drives_and_leaves_the_motor_standing(qcar_writes, capfd) -> None:
    car = QcarVehicle(time.monotonic_ns, board=lambda: GuardedBoard(DEADLINE_S, 0.3, api=FAKE_API))
    with car:
        car.arm()
        for _ in range(30):
            car.drive(DriveCommand(0.5, 0.0))
            car.poll()
            time.sleep(0.02)
    assert max(float(what) for _, what in qcar_writes() if what != "terminated") > 0.05
    assert [what for _, what in qcar_writes()][-2:] == ["0.0", "terminated"]
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "Quanser's API prints\n")


def test_the_guard_ends_with_its_vehicle_also_where_a_child_holds_the_socket_open(qcar_writes) -> None:
    board = GuardedBoard(DEADLINE_S, 0.3, api=FAKE_API)
    child = os.fork()
    if child == 0:
        time.sleep(10.0)
        os._exit(0)
    board.terminate()
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert qcar_writes()[-1][1] == "terminated"
