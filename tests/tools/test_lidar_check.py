from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from drivers.emulated_faults import FaultScript, parse_script
from drivers.faulty_line import FaultyLine
from drivers.pty_port import PtyPort
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M4, A2M8
from drivers.serial_link import open_serial
from tools.config import parse
from tools.lidar_check import LidarCheck, State, check_lidar

pytestmark = pytest.mark.live(cores=1)


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


def check(script: str = "", model=A2M8, settings: str = "", **options) -> LidarCheck:
    faults = FaultScript(parse_script(script))
    device = RplidarEmulator(model, wall, startup_s=0.1, script=faults, **options)
    lidar = {"lidar": dict(part.split("=") for part in settings.split())} if settings else {}
    with PtyPort(FaultyLine(device, faults, model.baud), model.baud) as port:
        return check_lidar(port.name, parse(lidar, "test"), 1.0, threading.Event())


def states(found: LidarCheck) -> dict[str, State]:
    return {finding.what: finding.state for finding in found.findings}


def of(found: LidarCheck, what: str) -> str:
    return next(f"{finding.text}: {finding.advice}" for finding in found.findings if finding.what == what)


def test_a_sensor_that_is_well() -> None:
    found = check()
    assert (found.simulated, found.state) == (True, State.OK), found
    assert list(states(found)) == [
        *("port", "group", "baud", "info", "health", "motor", "modes", "speed", "rate", "optics")
    ]
    assert "10.0 turns" in of(found, "speed")
    assert "Sensitivity (8000 samples/s, 12 m, 0x84)" in of(found, "modes")


@pytest.mark.parametrize(
    ("script", "options", "what", "state", "text"),
    [
        ("health=warning:7", {}, "health", State.WARN, "0x0007"),
        ("health=error:0x8001:stays", {}, "scan", State.FAIL, "also after a reset"),
        ("motor-stall", {}, "scan", State.FAIL, "motor"),
        ("invalid=0.9", {}, "optics", State.WARN, "clean the lens"),
        ("drop=0.001@0", {}, "line", State.WARN, "packets damaged"),
        ("mute=GET_INFO", {}, "baud", State.FAIL, "nothing answers"),
        ("silence@0.5", {}, "scan", State.FAIL, "5 V supply"),
        ("", {"board": False}, "motor", State.WARN, "normal on a bare UART"),
        ("", {"hz_at_default_pwm": 4.0}, "speed", State.WARN, "4.0 turns"),
        ("", {"model": A2M4}, "info", State.WARN, "two oldest modes"),
    ],
)
def test_what_is_not_well_has_a_line_with_a_remedy(script, options, what, state, text) -> None:
    found = check(script, **options)
    assert found.state == state
    assert states(found)[what] == state
    assert text in of(found, what)
    assert all(finding.advice for finding in found.findings if finding.state != State.OK)


@pytest.mark.parametrize("motor", ["dtr", "rts", "external"])
def test_a_motor_line_that_is_configured_is_no_warning(motor: str) -> None:
    found = check(settings=f"motor={motor}", board=False)
    assert states(found)["motor"] == State.OK
    assert motor.upper() in of(found, "motor").upper() or "outside" in of(found, "motor")


def test_a_mode_that_is_not_there() -> None:
    found = check(settings="mode=Turbo")
    assert states(found)["modes"] == State.FAIL
    assert "Turbo is none of them" in of(found, "modes")


def test_a_port_that_is_missing(tmp_path: Path) -> None:
    found = check_lidar(str(tmp_path / "none"), parse({}, "test"), 1.0, threading.Event())
    assert [(finding.what, finding.state) for finding in found.findings] == [("port", State.FAIL)]
    assert "no such port" in found.findings[0].text


def test_a_port_that_another_program_holds() -> None:
    device = RplidarEmulator(A2M8, wall)
    with PtyPort(device, A2M8.baud) as port, open_serial(port.name, A2M8.baud):
        found = check_lidar(port.name, parse({}, "test"), 1.0, threading.Event())
    assert found.findings[-1].state == State.FAIL
    assert "another process holds this port" in of(found, "port") + found.findings[-1].text
    assert "fuser" in found.findings[-1].advice


def test_doctor_prints_a_line_each_and_takes_its_code_from_the_worst(cli, tmp_path: Path) -> None:
    device = RplidarEmulator(A2M8, wall, startup_s=0.1, board=False)
    with PtyPort(device, A2M8.baud) as port:
        outcome = cli("doctor", "--lidar", port.name, "--seconds", "0.5")
        as_json = cli("doctor", "--lidar", port.name, "--seconds", "0.5", "--json")
    assert outcome.code == as_json.code == 3
    assert "  warn  motor   no accessory board answers" in outcome.out
    assert '"state": "warn"' in as_json.out
    assert cli("doctor", "--lidar", tmp_path / "none").code == 4


def test_a_udev_rule_is_printed(cli) -> None:
    outcome = cli("udev-rule", "--name", "rplidar")
    assert (outcome.code, outcome.out.strip().endswith('SYMLINK+="rplidar"')) == (0, True)
    assert cli("udev-rule", "--name", "two words").code == 2
    assert cli("udev-rule", "/dev/ttyNone").code == 4
    assert cli("udev-rule", "--device", "vehicle").out.count('SYMLINK+="vehicle"\n') == 3
    assert cli("udev-rule", "--device", "camera").out.count('SYMLINK+="camera"\n') == 2
    assert cli("udev-rule", "--device", "camera", "/dev/ttyNone").code == 2
