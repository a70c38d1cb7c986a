from __future__ import annotations

import struct

import numpy as np
import pytest

from drivers.rplidar_emulator import RplidarEmulator, split_requests
from drivers.rplidar_models import A2M8, A2M12
from drivers.rplidar_protocol import (
    Answer,
    Command,
    Conf,
    accessory_flag_request,
    conf_request,
    express_request,
    find_descriptor,
    parse_health,
    parse_info,
    pwm_request,
    request,
)

S = 1_000_000_000


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


def emulator(model=A2M8, startup_s: float = 0.5) -> RplidarEmulator:
    return RplidarEmulator(model, wall, startup_s=startup_s)


def test_identity() -> None:
    answer = emulator(A2M12).receive(request(Command.GET_INFO), 0)
    info = parse_info(answer[7:])
    assert (info.model, info.firmware, info.hardware) == ("A2M12", (1, 32), 6)
    assert answer[:7] == bytes.fromhex("A55A1400000004")


def test_requests_may_be_cut_and_surrounded_by_noise() -> None:
    device = emulator()
    sent = b"\x00\xa5" + conf_request(Conf.TYPICAL_MODE)
    answers = [device.receive(bytes([byte]), at) for at, byte in enumerate(sent)]
    assert b"".join(answers) == bytes.fromhex("A55A06000000207C0000000300")


def test_a_wrong_checksum_is_ignored() -> None:
    broken = conf_request(Conf.TYPICAL_MODE)[:-1] + b"\x00"
    assert emulator().receive(broken, 0) == b""
    assert split_requests(broken + request(Command.STOP)) == ([(Command.STOP, b"")], b"")


def test_half_a_request_is_forgotten() -> None:
    device = emulator()
    assert device.receive(b"\xa5\xf0\xff", 0) == b""
    assert device.receive(request(Command.GET_HEALTH), S)[7:] == bytes(3)


def test_the_modes_are_listed() -> None:
    device = emulator()
    count = device.receive(conf_request(Conf.MODE_COUNT), 0)
    assert struct.unpack("<H", count[11:]) == (5,)
    names = [device.receive(conf_request(Conf.MODE_NAME, mode), 0)[11:] for mode in range(5)]
    assert names == [b"Standard\0", b"Express\0", b"Boost\0", b"Sensitivity\0", b"Stability\0"]
    assert struct.unpack("<I", device.receive(conf_request(Conf.MODE_SAMPLE_US, 1), 0)[11:]) == (64000,)
    assert device.receive(conf_request(Conf.MODE_ANSWER, 3), 0)[11:] == b"\x84"
    assert device.receive(conf_request(Conf.MODE_NAME, 9), 0) == b""
    for entry in Conf:
        assert device.receive(conf_request(entry, 0), 0)


def test_small_answers() -> None:
    device = emulator()
    assert device.receive(request(Command.GET_SAMPLERATE), 0)[7:] == struct.pack("<HH", 500, 250)
    assert device.receive(accessory_flag_request(), 0) == bytes.fromhex("A55A04000000FF01000000")
    assert device.receive(request(0x77), 0) == b""


@pytest.mark.parametrize(
    ("question", "descriptor", "rate"),
    [
        (request(Command.SCAN), "A55A0500004081", 2000),
        (request(Command.FORCE_SCAN), "A55A0500004081", 2000),
        (express_request(0), "A55A5400004082", 4000),
        (express_request(1), "A55A5400004082", 4000),
        (express_request(3), "A55A8400004084", 8000),
    ],
)
def test_scans_begin_after_the_start_up_delay_at_their_rate(question: bytes, descriptor: str, rate: int) -> None:
    device = emulator()
    assert device.receive(question, S) == bytes.fromhex(descriptor)
    assert device.due(S + S // 2) == b""
    device.due(S + S // 2 + S)
    assert device.counters.samples_emitted == pytest.approx(rate, abs=200)
    device.receive(request(Command.STOP), 3 * S)
    assert device.due(4 * S) == b""


def test_how_often_due_is_asked_changes_nothing() -> None:
    one, other = emulator(), emulator()
    for device in (one, other):
        device.receive(express_request(3), 0)
    assert one.due(2 * S) == b"".join(other.due(now) for now in range(0, 2 * S + 1, S // 200))


def test_no_rotation_no_samples() -> None:
    device = emulator()
    device.receive(pwm_request(0), 0)
    assert device.receive(express_request(0), 0) != b""
    assert device.due(3 * S) == b""
    device.receive(pwm_request(660), 3 * S)
    assert device.due(3 * S + S // 4) == b""
    assert device.due(4 * S) != b""


def test_motor_and_board_requests_do_not_end_a_scan_but_others_do() -> None:
    device = emulator(startup_s=0.0)
    device.receive(express_request(0), 0)
    device.receive(pwm_request(700), S)
    device.receive(accessory_flag_request(), S)
    assert device.due(2 * S) != b""
    device.receive(request(Command.GET_HEALTH), 2 * S)
    assert device.due(3 * S) == b""


def test_reset_prints_a_banner_and_ends_the_scan() -> None:
    device = emulator(startup_s=0.0)
    device.receive(express_request(0), 0)
    device.receive(request(Command.RESET), S)
    assert device.receive(request(Command.GET_INFO), S + 1) == b""
    banner = device.due(2 * S)
    assert banner.startswith(b"RP LIDAR System.\r\n")
    assert len(banner) in (62, 63)
    assert device.receive(request(Command.GET_INFO), 2 * S) != b""


@pytest.mark.parametrize("outlives", [False, True])
def test_protection_stop(outlives: bool) -> None:
    device = emulator()
    device.trip_protection(0x8001, outlives_reset=outlives)
    health = parse_health(device.receive(request(Command.GET_HEALTH), 0)[7:])
    assert (health.stopped, health.error_code) == (True, 0x8001)
    assert device.receive(request(Command.SCAN), 0) == b""
    assert device.receive(request(Command.FORCE_SCAN), 0) != b""
    device.receive(request(Command.RESET), 0)
    device.due(S)
    answer = device.receive(request(Command.GET_HEALTH), S)
    found = find_descriptor(answer, Answer.HEALTH)
    assert found is not None
    assert parse_health(answer[found[1] :]).stopped == outlives
