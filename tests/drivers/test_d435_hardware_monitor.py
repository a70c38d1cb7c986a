from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from typing import Any, cast

import pytest

from drivers.d435_emulated_firmware import EMULATED_SERIAL, EmulatedFirmware
from drivers.d435_emulator import D435Emulator
from drivers.d435_hardware_monitor import (
    CameraNotReadyError,
    HardwareMonitor,
    HardwareMonitorError,
    Opcode,
    decode_answer,
    encode_request,
)
from drivers.emulated_link import SimulatedClock
from drivers.video_device import VideoDevice

WRITES_FLASH_OR_CALIBRATION = (0x0A, 0x0C, 0x16, 0x20, 0x2B, 0x2F, 0x61)
ANY_OPCODE_BUT_OURS = [code for code in range(256) if code not in {0x10, 0x15, 0x2C, 0x7E}]


def answer(echo: int, payload: bytes = b"", length: int | None = None) -> bytes:
    body = struct.pack("<i", echo) + payload
    return body.ljust(1020, b"\0") + struct.pack("<I", len(payload) if length is None else length)


class Bench:
    def __init__(self, **firmware: Any) -> None:
        self.clock = SimulatedClock()
        self.firmware = EmulatedFirmware(**firmware)
        camera = D435Emulator([], firmware=self.firmware, clock=self.clock, sleep=self.clock.sleep)
        self.device = VideoDevice(camera.path, camera)
        self.monitor = HardwareMonitor(self.device)


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.device.close()


def test_a_request_is_laid_out_as_published():
    request = encode_request(Opcode.TABLE, 25)
    assert len(request) == 1024
    assert request[:24].hex(" ", 4) == "1400abcd 15000000 19000000 00000000 00000000 00000000"
    assert not any(request[24:])


def test_only_commands_that_read_exist():
    assert {int(code) for code in Opcode} == {0x10, 0x15, 0x2C, 0x7E}
    assert not set(Opcode).intersection(WRITES_FLASH_OR_CALIBRATION)
    for code in ANY_OPCODE_BUT_OURS:
        with pytest.raises(ValueError, match="is not a valid Opcode"):
            encode_request(cast("Opcode", code))


def test_an_answer_is_cut_to_its_length():
    assert decode_answer(answer(0x10, b"payload"), Opcode.VERSION, "cam") == b"payload"
    assert decode_answer(answer(0x10, bytes(1016)), Opcode.VERSION, "cam") == bytes(1016)


@pytest.mark.parametrize(
    ("data", "kind", "code", "text"),
    [
        (answer(-1), HardwareMonitorError, -1, r"cam: the camera refuses VERSION with -1 \(unknown command\)"),
        (answer(-6), HardwareMonitorError, -6, "wrong parameter"),
        (answer(-21), HardwareMonitorError, -21, "no data"),
        (answer(-99), HardwareMonitorError, -99, "-99"),
        (answer(-7), CameraNotReadyError, -7, "not ready"),
        (answer(0x15), CameraNotReadyError, 0, "is one to 0x15: end other programs"),
        (answer(0x10, length=1017), HardwareMonitorError, 0, "claims 1017 bytes, expected at most 1016"),
    ],
)
def test_refusals_and_damage_are_typed(data, kind, code, text):
    with pytest.raises(HardwareMonitorError, match=text) as raised:
        decode_answer(data, Opcode.VERSION, "cam")
    assert type(raised.value) is kind
    assert raised.value.code == code


def test_version_and_unit_are_those_of_the_camera(bench):
    assert bench.monitor.present()
    version = bench.monitor.version()
    assert version.firmware == "5.12.7.100"
    assert version.serial == version.asic_serial == EMULATED_SERIAL
    assert bench.monitor.depth_unit_m() == pytest.approx(0.001)
    assert not bench.firmware.refused


def test_a_camera_without_this_control_is_known_without_a_command():
    class Webcam(EmulatedFirmware):
        def read(self, selector: int, query: int, size: int) -> bytes:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))

        def write(self, selector: int, data: bytes) -> None:
            raise AssertionError("nothing may be written to an unknown camera")

    camera = D435Emulator([], firmware=Webcam())
    assert not HardwareMonitor(VideoDevice(camera.path, camera)).present()


def test_the_unit_is_read_and_not_assumed():
    bench = Bench(unit_um=100)
    assert bench.monitor.depth_unit_m() == pytest.approx(1e-4)
    with pytest.raises(HardwareMonitorError, match="depth unit of 0 um"):
        Bench(unit_um=0).monitor.depth_unit_m()


@pytest.mark.parametrize("times", [1, 5, 19])
def test_a_camera_that_is_not_ready_is_asked_again(times):
    bench = Bench(not_ready=times)
    assert bench.monitor.version().firmware == "5.12.7.100"
    assert bench.clock.now_ns == pytest.approx(times * 0.1e9)


def test_a_camera_that_never_gets_ready_is_an_error_after_two_seconds():
    bench = Bench(not_ready=1000)
    with pytest.raises(CameraNotReadyError, match="not ready"):
        bench.monitor.version()
    assert 1.5e9 < bench.clock.now_ns < 2.5e9


def test_a_short_answer_is_an_error(bench):
    with pytest.raises(HardwareMonitorError, match="VERSION answered with 256 bytes, expected 300"):
        bench.monitor._ask_at_least(Opcode.VERSION, 300)


def test_old_firmware_refuses_what_it_does_not_know():
    bench = Bench(rectification=False)
    with pytest.raises(HardwareMonitorError, match="unknown command") as raised:
        bench.monitor.rectification()
    assert raised.value.code == -1
    assert len(bench.monitor.coefficients()) == 512
