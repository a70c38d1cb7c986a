from __future__ import annotations

import struct

import pytest

from drivers.errors import DeviceFaultError
from drivers.rplidar_protocol import (
    Answer,
    Command,
    Conf,
    Descriptor,
    DeviceInfo,
    Health,
    SampleRate,
    accessory_flag_request,
    conf_request,
    conf_value,
    express_request,
    find_descriptor,
    parse_health,
    parse_info,
    parse_name,
    parse_q8,
    parse_sample_rate,
    pwm_request,
    request,
)


@pytest.mark.parametrize(
    ("built", "wire"),
    [
        (request(Command.STOP), "A525"),
        (request(Command.GET_INFO), "A550"),
        (express_request(0), "A58205000000000022"),
        (express_request(1), "A58205010000000023"),
        (express_request(2), "A58205020000000020"),
        (express_request(3), "A58205030000000021"),
        (conf_request(Conf.TYPICAL_MODE), "A584047C00000059"),
        (pwm_request(660), "A5F0029402C1"),
        (pwm_request(0), "A5F002000057"),
        (pwm_request(1023), "A5F002FF03AB"),
        (accessory_flag_request(), "A5FF04000000005E"),
    ],
)
def test_requests(built: bytes, wire: str) -> None:
    assert built == bytes.fromhex(wire)


def test_a_mode_entry_carries_the_mode_id() -> None:
    assert conf_request(Conf.MODE_NAME, 3)[:9] == bytes.fromhex("A584067F0000000300")


@pytest.mark.parametrize("pwm", [-1, 1024])
def test_motor_duty_out_of_range(pwm: int) -> None:
    with pytest.raises(ValueError, match=f"{pwm}.*1023"):
        pwm_request(pwm)


@pytest.mark.parametrize(
    ("wire", "descriptor"),
    [
        ("A55A0500004081", Descriptor(5, True, Answer.NODES)),
        ("A55A5400004082", Descriptor(84, True, Answer.EXPRESS)),
        ("A55A8400004084", Descriptor(132, True, Answer.ULTRA)),
        ("A55A1400000004", Descriptor(20, False, Answer.INFO)),
    ],
)
def test_descriptors(wire: str, descriptor: Descriptor) -> None:
    data = bytes.fromhex(wire)
    assert descriptor.encode() == data
    stale = b"Model: 28\r\n\xa5\xa5\x5a"
    found = find_descriptor(stale + data + b"x", descriptor.kind, repeats=descriptor.repeats, size=descriptor.size)
    assert found == (descriptor, len(stale) + 7)
    assert find_descriptor(data[:-1], descriptor.kind, repeats=descriptor.repeats) is None
    assert find_descriptor(data, descriptor.kind, repeats=not descriptor.repeats) is None
    assert find_descriptor(data, descriptor.kind, repeats=descriptor.repeats, size=descriptor.size + 1) is None


def test_info() -> None:
    info = parse_info(bytes([0x28, 20, 1, 2]) + bytes(range(16)))
    assert info == DeviceInfo(0x28, (1, 20), 2, "000102030405060708090A0B0C0D0E0F")
    assert (info.model, info.firmware_text) == ("A2M8", "1.20")
    assert DeviceInfo(0x2C, (1, 5), 6, "").model == "A2M12"
    assert DeviceInfo(0x61, (1, 5), 6, "").model == "0x61"
    assert DeviceInfo(0x2C, (1, 5), 6, "").firmware_text == "1.05"


def test_health_code_is_little_endian() -> None:
    assert parse_health(bytes.fromhex("020180")) == Health(2, 0x8001)
    assert parse_health(bytes.fromhex("020180")).stopped
    assert not parse_health(bytes(3)).stopped


def test_values() -> None:
    assert parse_sample_rate(struct.pack("<HH", 500, 250)) == SampleRate(500, 250)
    assert parse_q8(struct.pack("<I", 64000), "sample time") == 250.0
    assert parse_name(b"Boost\0junk") == "Boost"
    assert conf_value(b"\x7c\0\0\0\x03\0", Conf.TYPICAL_MODE) == b"\x03\0"


def test_answers_of_the_wrong_kind_are_faults() -> None:
    with pytest.raises(DeviceFaultError, match="0x70.*0x7C"):
        conf_value(b"\x70\0\0\0\x03\0", Conf.TYPICAL_MODE)
    with pytest.raises(DeviceFaultError, match="2 bytes, expected 3"):
        parse_health(b"\0\0")
