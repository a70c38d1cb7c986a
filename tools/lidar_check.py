"""A look at the lidar: may its port be opened, what is on it, is it well, how fast does it turn and measure."""

from __future__ import annotations

import grp
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from drivers.errors import DriverError, PortBusyError, PortMissingError, PortPermissionError
from drivers.messages import LaserScan, RawChunk
from drivers.rplidar import Rplidar, open_rplidar
from drivers.rplidar_decoder import DecoderCounters, RplidarDecoder, load_compiled
from drivers.rplidar_models import is_emulated
from drivers.rplidar_motor import MotorControl
from drivers.rplidar_protocol import FIRST_FIRMWARE_WITH_CONF, ScanMode
from drivers.scan_reader import turn_rate_hz
from drivers.serial_names import LINK_FOLDERS, stable_path
from tools.config import Config

SPEEDS_HZ = (5.0, 15.0)  # of an A2, by its data sheet
_SAME_RATE = 0.05
_LEAST_VALID = 0.2
_ABOUT = {PortMissingError: "port", PortBusyError: "port", PortPermissionError: "group"}


class State(str, Enum):
    """How a finding is to be taken."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the check: what was looked at, how it is, and what to do where it is not well."""

    what: str
    state: State
    text: str
    advice: str = ""


@dataclass(frozen=True, slots=True)
class LidarCheck:
    """All findings in the order in which they were made; those after a failure that ends it are missing."""

    port: str
    simulated: bool
    findings: tuple[Finding, ...]

    @property
    def state(self) -> State:
        """The worst of them."""
        states = {finding.state for finding in self.findings}
        return next((state for state in (State.FAIL, State.WARN) if state in states), State.OK)


@dataclass(frozen=True, slots=True)
class _Measured:
    """A few seconds of a running scan."""

    mode: ScanMode
    speed_hz: float | None
    samples_hz: float
    counters: DecoderCounters


def check_lidar(port: str, config: Config, seconds: float, stop: threading.Event) -> LidarCheck:
    """Open the port, ask the sensor and measure for so many seconds; never raises DriverError, which is a finding."""
    findings = [*_look_at_port(port)]
    simulated = False
    motor = MotorControl(config.lidar.motor)
    what = "baud"
    try:
        with open_rplidar(port, baud=config.lidar.baud, motor=motor) as lidar:
            simulated = is_emulated(lidar.info().serial)
            findings.append(Finding("baud", State.OK, f"answers at {lidar.baud}"))
            for step, look in (
                ("info", _look_at_info),
                ("health", _look_at_health),
                ("motor", lambda lidar: _look_at_motor(lidar, motor)),
                ("modes", lambda lidar: _look_at_modes(lidar, config.lidar.mode)),
            ):
                what = step
                findings.append(look(lidar))
            what = "scan"
            findings += _judge(_measure(lidar, config, seconds, stop), config)
    except DriverError as error:
        what = _ABOUT.get(type(error), what)
        text, _, advice = str(error).removeprefix(f"{port}: ").rpartition(": ")
        findings.append(Finding(what, State.FAIL, text or str(error), advice if text else ""))
    return LidarCheck(port, simulated, tuple(findings))


def _look_at_port(port: str) -> Iterator[Finding]:
    if "://" in port:
        yield Finding("port", State.OK, f"{port} is on the network")
        return
    path = Path(port)
    if not path.exists():
        return  # opening it says what there is
    stable = stable_path(port)
    is_usb = path.resolve().name.startswith(("ttyUSB", "ttyACM"))
    if is_usb and stable == port and not path.is_symlink():
        folder = LINK_FOLDERS[0]
        advice = f"name it by {folder}/... or make a rule with `mapfuse-robot udev-rule {port}`"
        yield Finding("port", State.WARN, f"{port} may have another name after unplugging", advice)
    else:
        yield Finding(
            "port", State.OK, f"{port} is there" + ("" if stable == port else f", also after boot as {stable}")
        )
    gid = path.stat().st_gid
    try:
        group = grp.getgrgid(gid).gr_name
    except KeyError:
        group = str(gid)
    if os.access(path, os.R_OK | os.W_OK):
        yield Finding("group", State.OK, f"of group {group}; you may read and write it")


def _look_at_info(lidar: Rplidar) -> Finding:
    info = lidar.info()
    text = f"{info.model}, firmware {info.firmware_text}, hardware {info.hardware}, serial {info.serial}"
    if info.firmware < FIRST_FIRMWARE_WITH_CONF:
        return Finding("info", State.WARN, f"{text}: knows the two oldest modes only", "update the firmware for more")
    return Finding("info", State.OK, text)


def _look_at_health(lidar: Rplidar) -> Finding:
    health = lidar.health()
    if health.stopped:
        text = f"protection stop, error code 0x{health.error_code:04X}; a reset is tried next"
        return Finding("health", State.WARN, text, "free the head, check the 5 V supply")
    if health.status:
        return Finding(
            "health", State.WARN, f"warning, code 0x{health.error_code:04X}", "clean the lens, check the 5 V supply"
        )
    return Finding("health", State.OK, "good")


def _look_at_motor(lidar: Rplidar, control: MotorControl) -> Finding:
    if lidar.has_motor_board():
        return Finding("motor", State.OK, "driven by the USB accessory board")
    if control == MotorControl.EXTERNAL:
        return Finding("motor", State.OK, "driven from outside, as configured: it is not stopped at the end")
    if control == MotorControl.AUTO:
        text = "no accessory board answers, as is normal on a bare UART such as a QCar's; DTR is taken as its switch"
        return Finding("motor", State.WARN, text, "set lidar.motor to dtr, rts or external, as MOTOCTL is wired")
    return Finding("motor", State.OK, f"switched by {control.value.upper()}, as configured")


def _look_at_modes(lidar: Rplidar, wanted: str | None) -> Finding:
    modes, typical = lidar.scan_modes(), lidar.typical_mode()
    text = f"{', '.join(mode.text for mode in modes)}; typical: {typical.name}"
    if wanted is not None and wanted.lower() not in {mode.name.lower() for mode in modes}:
        return Finding("modes", State.FAIL, text, f"lidar.mode {wanted} is none of them: choose one or leave it out")
    return Finding("modes", State.OK, text)


def _measure(lidar: Rplidar, config: Config, seconds: float, stop: threading.Event) -> _Measured:
    load_compiled()
    modes = lidar.scan_modes()
    stream = lidar.start(config.lidar.mode, config.lidar.motor_pwm)
    mode = next(mode for mode in modes if mode.name == stream.mode)
    decoder, scans = RplidarDecoder(stream), list[LaserScan]()
    first_ns = last_ns = 0
    for message in lidar:
        if not isinstance(message, RawChunk):
            continue
        first_ns, last_ns = first_ns or message.stamp_ns, message.stamp_ns
        scans += decoder.feed(message)
        if last_ns - first_ns > seconds * 1e9 or stop.is_set():
            lidar.request_stop()
    whole = [scan.stamp_ns for scan in scans if scan.complete]
    counters = decoder.counters
    passed_s = max((last_ns - first_ns) * 1e-9, 1e-3)
    return _Measured(mode, turn_rate_hz(whole), counters.samples / passed_s, counters)


def _judge(measured: _Measured, config: Config) -> Iterator[Finding]:
    speed, (low, high) = measured.speed_hz, SPEEDS_HZ
    if speed is None:
        yield Finding("speed", State.FAIL, "no two whole turns came", "free the head, check cable and 5 V supply")
    elif not low <= speed <= high:
        advice = f"change lidar.motor_pwm ({config.lidar.motor_pwm}), or check MOTOCTL and the 5 V supply"
        yield Finding("speed", State.WARN, f"{speed:.1f} turns a second, made for {low:g} to {high:g}", advice)
    else:
        yield Finding("speed", State.OK, f"{speed:.1f} turns a second")
    nominal = 1e6 / measured.mode.sample_us
    text = f"{measured.samples_hz:.0f} samples a second in mode {measured.mode.name}, nominally {nominal:.0f}"
    if abs(measured.samples_hz / nominal - 1.0) > _SAME_RATE:
        yield Finding("rate", State.WARN, text, "samples are lost: another USB port, a shorter cable, less load")
    else:
        yield Finding("rate", State.OK, text)
    counters = measured.counters
    if counters.rejected_packets:
        text = f"{counters.rejected_packets} of {counters.packets} packets damaged"
        yield Finding("line", State.WARN, text, "a shorter or shielded cable, another adapter, a better 5 V supply")
    valid = counters.valid_samples / counters.samples if counters.samples else 0.0
    text = f"{valid:.0%} of the samples are measurements"
    yield Finding(
        "optics",
        State.OK if valid >= _LEAST_VALID else State.WARN,
        text,
        "" if valid >= _LEAST_VALID else "clean the lens; outdoors and in large halls few rays return",
    )
