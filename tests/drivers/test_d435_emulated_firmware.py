from __future__ import annotations

import errno
import struct
import zlib

import pytest

from drivers.d435_emulated_firmware import (
    EMULATED_SERIAL,
    USB3_MODES,
    EmulatedFirmware,
    coefficients_payload,
    emulated_pinhole,
    is_emulated_camera,
    rectification_payload,
)

MONITOR = 1
GET_CUR, GET_MIN, GET_MAX, GET_RES, GET_LEN = 0x81, 0x82, 0x83, 0x84, 0x85


def ask(firmware: EmulatedFirmware, opcode: int, *parameters: int) -> tuple[int, bytes]:
    """The echo and the payload of an answer, by the published layout."""
    command = struct.pack("<HHI4I", 20, 0xCDAB, opcode, *parameters, *(0,) * (4 - len(parameters)))
    firmware.write(MONITOR, command.ljust(1024, b"\0"))
    answer = firmware.read(MONITOR, GET_CUR, 1024)
    (length,) = struct.unpack_from("<I", answer, 1020)
    return struct.unpack_from("<i", answer)[0], answer[4 : 4 + length]


def test_nothing_can_be_written_or_reset():
    firmware = EmulatedFirmware()
    before = [ask(firmware, opcode, *parameters) for opcode, *parameters in ((0x10,), (0x15, 25), (0x2C, 9), (0x7E,))]
    harmless = {0x10, 0x15, 0x2C, 0x7E}
    others = [opcode for opcode in range(256) if opcode not in harmless]
    assert all(ask(firmware, opcode) == (-1, b"") for opcode in others)
    assert firmware.refused == others
    assert before == [
        ask(firmware, opcode, *parameters) for opcode, *parameters in ((0x10,), (0x15, 25), (0x2C, 9), (0x7E,))
    ]


def test_the_table_is_as_long_as_a_real_one_and_its_sum_is_right():
    table = coefficients_payload()
    assert len(table) == 512
    assert struct.unpack_from("<I", table, 12)[0] == zlib.crc32(table[16:])
    assert struct.unpack_from("<f", table, 160)[0] == pytest.approx(-50.05), "mm from the left to the right imager"
    camera = emulated_pinhole((848, 480))
    expected = (camera.fx, camera.fy, camera.cx, camera.cy)
    assert struct.unpack_from("<ffff", table, 256 + 3 * 16) == pytest.approx(expected)
    broken = coefficients_payload(sound=False)
    assert struct.unpack_from("<I", broken, 12)[0] != zlib.crc32(broken[16:])


def test_rectification_has_a_row_of_twenty_bytes_for_each_whole_mode():
    sizes = [row[:2] for row in struct.iter_unpack("<HHffff", rectification_payload())]
    assert sizes == [size for size in USB3_MODES if size not in {(848, 100), (256, 144)}]


def test_other_tables_and_settings_are_wrong_parameters():
    firmware = EmulatedFirmware()
    assert ask(firmware, 0x15, 31) == (-6, b"")
    assert ask(firmware, 0x2C, 9, 1) == (-6, b"")
    assert not firmware.refused


def test_not_ready_counts_down():
    firmware = EmulatedFirmware(not_ready=2)
    assert [ask(firmware, 0x10)[0] for _ in range(4)] == [-7, -7, 0x10, 0x10]


def test_the_kernel_s_errors_for_wrong_controls():
    firmware = EmulatedFirmware()
    for action, code in (
        (lambda: firmware.write(MONITOR, bytes(1023)), errno.ENOBUFS),
        (lambda: firmware.read(MONITOR, GET_CUR, 512), errno.ENOBUFS),
        (lambda: firmware.write(3, bytes(2)), errno.ENOBUFS),
        (lambda: firmware.write(4, (361).to_bytes(2, "little")), errno.ERANGE),
        (lambda: firmware.read(99, GET_CUR, 1), errno.ENOENT),
        (lambda: firmware.read(99, GET_LEN, 2), errno.ENOENT),
        (lambda: firmware.read(2, GET_RES, 1), errno.EINVAL),
    ):
        with pytest.raises(OSError, match=r"\[Errno") as raised:
            action()
        assert raised.value.errno == code


def test_sizes_and_bounds_of_controls():
    firmware = EmulatedFirmware()
    sizes = [int.from_bytes(firmware.read(selector, GET_LEN, 2), "little") for selector in (1, 2, 3, 4, 0xB)]
    assert sizes == [1024, 1, 4, 2, 1]
    bounds = [int.from_bytes(firmware.read(4, query, 2), "little") for query in (GET_MIN, GET_CUR, GET_MAX)]
    assert bounds == [0, 150, 360]


def test_an_emulated_camera_is_known_by_its_serial_number():
    assert is_emulated_camera(EMULATED_SERIAL)
    assert not is_emulated_camera("841512070533")
    assert ask(EmulatedFirmware(), 0x10)[1][48:54].hex().upper() == EMULATED_SERIAL
