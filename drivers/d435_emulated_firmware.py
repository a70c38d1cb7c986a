"""The firmware of an emulated D435: answers to its hardware monitor, calibration tables, projector and exposure.

Reads requests by the published layout, not by the driver's own code. Refuses and remembers every command that is not
one of the four that read; nothing here can be written but the volatile controls.
"""

from __future__ import annotations

import errno
import os
import struct
import zlib
from collections.abc import Callable, Mapping

from drivers.d435_calibration import (
    RECTIFICATION_ROW,
    TABLE_HEADER,
    TABLE_ROW,
    TABLE_SIZES,
    Size,
    nominal_pinhole,
)
from drivers.messages import Pinhole

EMULATED_SERIAL = "EE4350000001"  # of a module that no factory has made
USB3_MODES: Mapping[Size, tuple[int, ...]] = {
    (1280, 720): (6, 15, 30),
    (848, 480): (6, 15, 30, 60, 90),
    (640, 480): (6, 15, 30, 60, 90),
    (640, 360): (6, 15, 30, 60, 90),
    (480, 270): (6, 15, 30, 60, 90),
    (424, 240): (6, 15, 30, 60, 90),
    (848, 100): (100, 300),
    (256, 144): (90,),
}
_MESSAGE_BYTES = 1024
_ECHO_BYTES = 4
_WRONG_COMMAND, _WRONG_PARAMETER, _NOT_READY = -1, -6, -7
_GVD, _GETINTCAL, _GET_ADV, _RECPARAMSGET = 0x10, 0x15, 0x2C, 0x7E
_GET_CUR, _GET_MIN, _GET_MAX, _GET_LEN = 0x81, 0x82, 0x83, 0x85
_MONITOR = 1
_CONTROLS = {2: (1, 0, 2, 1), 3: (4, 1, 200_000, 8500), 4: (2, 0, 360, 150), 0xB: (1, 0, 1, 1)}  # size, min, max, value


def is_emulated_camera(serial: str) -> bool:
    """Whether a module's serial number is the emulator's, which no camera has: its data are simulated."""
    return serial == EMULATED_SERIAL


def emulated_pinhole(size: Size) -> Pinhole:
    """Intrinsics of the emulated camera: near the nominal ones but not the same, so that one sees which are used."""
    camera = nominal_pinhole(size)
    stretch = size[0] / 848
    return Pinhole(*size, camera.fx * 0.99, camera.fy * 0.991, camera.cx + 3.2 * stretch, camera.cy - 2.4 * stretch)


class EmulatedFirmware:
    """State of one camera.

    unit_um: depth unit. rectification: False for firmware before 5.11.9.5, which does not know that question.
    sound_table: False damages calibration table 25 after its CRC was made. not_ready: so many commands are answered
    with "hardware not ready" first. refused: opcodes that came and are none that only read.
    """

    def __init__(
        self, *, unit_um: int = 1000, rectification: bool = True, sound_table: bool = True, not_ready: int = 0
    ) -> None:
        self.refused: list[int] = []
        self._unit_um = unit_um
        self._sound_table = sound_table
        self._not_ready = not_ready
        self._answer = bytes(_MESSAGE_BYTES)
        self._answers: dict[int, Callable[..., bytes | None]] = {
            _GVD: self._version,
            _GETINTCAL: self._table,
            _GET_ADV: self._advanced,
        }
        if rectification:
            self._answers[_RECPARAMSGET] = lambda *_: rectification_payload()
        self._values = {selector: value for selector, (*_, value) in _CONTROLS.items()}

    def control(self, selector: int) -> int:
        """Return the present value of a control by its selector."""
        return self._values[selector]

    def write(self, selector: int, data: bytes) -> None:
        """Set a control or take a command; raises OSError with the kernel's errno."""
        self._require_size(selector, len(data))
        if selector == _MONITOR:
            self._answer = self._obey(data)
            return
        _, least, most, _ = _CONTROLS[selector]
        value = int.from_bytes(data, "little")
        if not least <= value <= most:
            raise _system_error(errno.ERANGE)
        self._values[selector] = value

    def read(self, selector: int, query: int, size: int) -> bytes:
        """Return a control's value, bound or size; raises OSError with the kernel's errno."""
        if query == _GET_LEN and size == 2:
            if selector != _MONITOR and selector not in _CONTROLS:
                raise _system_error(errno.ENOENT)
            length = _MESSAGE_BYTES if selector == _MONITOR else _CONTROLS[selector][0]
            return length.to_bytes(2, "little")
        self._require_size(selector, size)
        if selector == _MONITOR:
            return self._answer
        _, least, most, _ = _CONTROLS[selector]
        values = {_GET_CUR: self._values[selector], _GET_MIN: least, _GET_MAX: most}
        if query not in values:
            raise _system_error(errno.EINVAL)
        return values[query].to_bytes(size, "little")

    def _require_size(self, selector: int, size: int) -> None:
        expected = _MESSAGE_BYTES if selector == _MONITOR else _CONTROLS.get(selector, (0,))[0]
        if not expected:
            raise _system_error(errno.ENOENT)
        if size != expected:
            raise _system_error(errno.ENOBUFS)

    def _obey(self, command: bytes) -> bytes:
        size, magic, opcode, *parameters = struct.unpack_from("<HHI4I", command)
        if magic != 0xCDAB or size != 20:
            return _reply(_WRONG_COMMAND)
        if self._not_ready > 0:
            self._not_ready -= 1
            return _reply(_NOT_READY)
        try:
            payload = self._answers[opcode](*parameters)
        except KeyError:
            if opcode != _RECPARAMSGET:
                self.refused.append(opcode)
            return _reply(_WRONG_COMMAND)
        return _reply(_WRONG_PARAMETER) if payload is None else _reply(opcode, payload)

    def _table(self, table: int, *_: int) -> bytes | None:
        return coefficients_payload(sound=self._sound_table) if table == 25 else None

    def _advanced(self, table: int, which: int, *_: int) -> bytes | None:
        return struct.pack("<Iiiii", self._unit_um, 0, 65536, 0, 0) if (table, which) == (9, 0) else None

    def _version(self, *_: int) -> bytes:
        payload = bytearray(256)
        payload[12:16] = bytes((100, 7, 12, 5) if _RECPARAMSGET in self._answers else (0, 14, 9, 5))
        payload[48:54] = payload[64:70] = bytes.fromhex(EMULATED_SERIAL)
        return bytes(payload)


def rectification_payload() -> bytes:
    """Intrinsics of all depth modes that come from a whole image."""
    cameras = [emulated_pinhole(size) for size in USB3_MODES if size not in {(848, 100), (256, 144)}]
    rows = [(each.width, each.height, each.fx, each.fy, each.cx, each.cy) for each in cameras]
    return b"".join(RECTIFICATION_ROW.pack(*row) for row in rows)


def coefficients_payload(*, sound: bool = True) -> bytes:
    """Calibration table 25 as a real one: 512 bytes, unused rows zero."""
    rows = b"".join(
        bytes(TABLE_ROW.size) if camera is None else TABLE_ROW.pack(camera.fx, camera.fy, camera.cx, camera.cy)
        for camera in (None if size is None else emulated_pinhole(size) for size in TABLE_SIZES)
    )
    matrices = bytes(4 * 36)
    body = matrices + struct.pack("<fI", -50.05, 0) + bytes(88) + rows
    header = TABLE_HEADER.pack(0x0200, 25, len(body), 0, zlib.crc32(body))
    return header + (body if sound else bytes((body[0] ^ 1,)) + body[1:])


def _reply(echo: int, payload: bytes = b"") -> bytes:
    answer = struct.pack("<i", echo) + payload
    return answer.ljust(_MESSAGE_BYTES - _ECHO_BYTES, b"\0") + struct.pack("<I", len(payload))


def _system_error(code: int) -> OSError:
    return OSError(code, os.strerror(code))
