from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.emulated_faults import FaultScript, parse_script
from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.rplidar import connect
from drivers.rplidar_answers import split_requests
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M4, A2M8, A2M12, MODELS
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


def test_old_firmware_ignores_what_it_does_not_know() -> None:
    for model in (A2M4, A2M8.with_firmware((1, 20))):
        device = emulator(model)
        assert all(device.receive(conf_request(entry, 0), 0) == b"" for entry in Conf)
        assert device.receive(request(Command.GET_SAMPLERATE), 0)[7:] == struct.pack("<HH", 500, 250)
        assert device.receive(express_request(1), 0) == b""
        assert device.receive(express_request(0), 0) != b""
    assert emulator(A2M8.with_firmware((1, 15))).receive(request(Command.GET_SAMPLERATE), 0) == b""


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_each_personality_lists_to_the_driver_what_it_offers(model) -> None:
    clock = SimulatedClock()
    device = emulator(model)
    with connect(lambda baud: EmulatedLink(device, clock, model.baud, baud), clock=clock, sleep=clock.sleep) as lidar:
        assert (lidar.info().model, lidar.baud) == (model.name, model.baud)
        names = [(mode.name, mode.sample_us, mode.answer_type) for mode in lidar.scan_modes()]
        assert names == [(mode.name, mode.sample_us, mode.answer_type) for mode in model.modes]
        assert lidar.typical_mode().name == model.modes[model.typical_id].name


def test_bare_wiring_has_no_board_and_a_motor_pin() -> None:
    device = RplidarEmulator(A2M8, wall, startup_s=0.0, board=False)
    assert device.receive(accessory_flag_request(), 0) == b""
    device.receive(express_request(0), 0)
    device.receive(pwm_request(0), 0)
    assert device.due(S) != b""
    device.drive_motor(0, S)
    assert device.due(2 * S) == b""
    device.drive_motor(660, 2 * S)
    assert device.due(3 * S) != b""


def faulty(script: str, **options) -> RplidarEmulator:
    return RplidarEmulator(A2M8, wall, startup_s=0.0, script=FaultScript(parse_script(script), 1), **options)


def test_a_stalled_motor_stops_the_data_and_a_freed_one_resumes_it() -> None:
    device = faulty("motor-stall@1+1")
    device.receive(express_request(3), 0)
    assert device.due(S - 1) != b""
    device.due(S)
    assert device.due(2 * S - 1) == b""
    device.receive(pwm_request(700), 2 * S - 1)
    device.due(2 * S)
    assert device.due(3 * S) != b""


@pytest.mark.parametrize(("stays", "after"), [("", 0), (":stays", 2)])
def test_health_by_script(stays: str, after: int) -> None:
    device = faulty(f"health=error:0x8001{stays}")
    health = parse_health(device.receive(request(Command.GET_HEALTH), 0)[7:])
    assert (health.status, health.error_code) == (2, 0x8001)
    assert device.receive(request(Command.SCAN), 0) == b""
    device.receive(request(Command.RESET), 0)
    device.due(S)
    assert parse_health(device.receive(request(Command.GET_HEALTH), S)[7:]).status == after


def test_a_warning_scans_and_passes() -> None:
    device = faulty("health=warning:7@1+1")
    assert device.receive(request(Command.SCAN), 0) != b""
    states = [parse_health(device.receive(request(Command.GET_HEALTH), at)[7:]).status for at in (0, S, 2 * S)]
    assert states == [0, 1, 0]
    assert device.receive(request(Command.SCAN), S) != b""


def test_a_mute_request_a_banner_and_a_reboot() -> None:
    device = faulty("mute=GET_INFO\nbanner@1\nreboot@2")
    assert device.receive(request(Command.GET_INFO), 0) == b""
    device.receive(request(Command.SCAN), 0)
    assert b"RP LIDAR System" in device.due(S)
    assert b"RP LIDAR System" not in device.due(S + S // 2)
    assert device.due(2 * S).startswith(b"RP LIDAR System")
    assert device.due(3 * S) == b""


def test_power_up_ends_the_scan_and_prints_the_banner() -> None:
    device = emulator(startup_s=0.0)
    device.receive(express_request(0), 0)
    device.power_up(S)
    assert device.due(2 * S).startswith(b"RP LIDAR System.")
    assert device.due(3 * S) == b""


KNOWN = st.sampled_from([request(Command.SCAN), express_request(3), request(Command.RESET), pwm_request(0), b"\xa5"])


@given(st.lists(st.tuples(st.one_of(st.binary(max_size=12), KNOWN), st.integers(0, S // 2)), max_size=20))
def test_whatever_a_host_sends_the_next_sound_question_is_answered(sent: list[tuple[bytes, int]]) -> None:
    device, now = emulator(startup_s=0.0), 0
    for data, passed in sent:
        now += passed
        device.receive(data, now)
        device.due(now)
    now += S
    device.due(now)
    assert device.receive(request(Command.GET_INFO), now)[7:].endswith(A2M8.serial)
    assert device.due(now + S) == b""
