"""Questions to the firmware of a RealSense D400 camera, through its UVC extension unit.

A request and its answer are 1024 bytes each on one control. Only the four questions of Opcode can be asked: commands
that write flash or calibration are not known to this code. Facts from librealsense (ds-private.h, hw-monitor.cpp).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from drivers import v4l2
from drivers.errors import DeviceFaultError, PortBusyError
from drivers.video_device import VideoDevice

DEPTH_UNIT = 3  # number of the extension unit on the depth node
MESSAGE_BYTES = 1024  # the kernel refuses any other size on this control
MAGIC = 0xCDAB
COEFFICIENTS_TABLE = 25
DEPTH_TABLE = 9  # the part of the advanced settings that holds the depth unit
NOT_READY = -7
_REQUEST = struct.Struct("<HHIIIII")  # bytes after the first four, magic, opcode, four parameters
_LENGTH_AT = MESSAGE_BYTES - 4
_ATTEMPTS = 20
_PAUSE_S = 0.1
_MEANINGS = {-1: "unknown command", -6: "wrong parameter", NOT_READY: "not ready", -21: "no data", -25: "empty table"}


class Opcode(IntEnum):
    """What may be asked; every one only reads."""

    VERSION = 0x10  # GVD
    TABLE = 0x15  # GETINTCAL, a calibration table
    ADVANCED_SETTINGS = 0x2C  # GET_ADV
    RECTIFICATION = 0x7E  # RECPARAMSGET, intrinsics per image size; firmware 5.11.9.5 and later


class Selector(IntEnum):
    """Controls of the extension unit."""

    HARDWARE_MONITOR = 1
    EMITTER = 2  # u8: 0 off, 1 laser, 2 automatic
    EXPOSURE = 3  # u32, us
    LASER_POWER = 4  # u16, mW
    AUTO_EXPOSURE = 0xB  # u8


class HardwareMonitorError(DeviceFaultError):
    """The firmware refuses a question or answers it with something else; code is its own number, 0 if it gave none."""

    def __init__(self, text: str, code: int = 0) -> None:
        super().__init__(text)
        self.code = code


class CameraNotReadyError(HardwareMonitorError):
    """The firmware was not ready, however often it was asked."""


@dataclass(frozen=True, slots=True)
class CameraVersion:
    """Firmware version and serial numbers (hex) of module and ASIC."""

    firmware: str
    serial: str
    asic_serial: str


def encode_request(opcode: Opcode, *parameters: int) -> bytes:
    """Return the 1024 bytes that ask; up to four parameters. Raises ValueError for what Opcode does not list."""
    padded = (*parameters, *(0,) * (4 - len(parameters)))
    request = _REQUEST.pack(_REQUEST.size - 4, MAGIC, Opcode(opcode), *padded)
    return request.ljust(MESSAGE_BYTES, b"\0")


def decode_answer(answer: bytes, opcode: Opcode, port: str) -> bytes:
    """Return the payload; raises HardwareMonitorError for a refusal or an answer to something else."""
    (code,) = struct.unpack_from("<i", answer)
    if code < 0:
        meaning = _MEANINGS.get(code, "see the list of librealsense")
        kind = CameraNotReadyError if code == NOT_READY else HardwareMonitorError
        raise kind(f"{port}: the camera refuses {opcode.name} with {code} ({meaning}): replug it, update it", code)
    if code != opcode:
        raise CameraNotReadyError(
            f"{port}: the answer to {opcode.name} is one to 0x{code:02X}: end other programs that use the camera"
        )
    (length,) = struct.unpack_from("<I", answer, _LENGTH_AT)
    if length > _LENGTH_AT - 4:
        raise HardwareMonitorError(
            f"{port}: the answer to {opcode.name} claims {length} bytes, expected at most {_LENGTH_AT - 4}: replug it"
        )
    return answer[4 : 4 + length]


class HardwareMonitor:
    """Asks the firmware of the camera behind an open depth node; raises HardwareMonitorError or DeviceLostError."""

    def __init__(self, device: VideoDevice) -> None:
        self._device = device

    def present(self) -> bool:
        """Whether the node has this control; says so without sending a command."""
        try:
            size = self._device.read_control(DEPTH_UNIT, Selector.HARDWARE_MONITOR, 2, v4l2.UVC_GET_LEN)
        except DeviceFaultError:
            return False
        return int.from_bytes(size, "little") == MESSAGE_BYTES

    def ask(self, opcode: Opcode, *parameters: int) -> bytes:
        """Return the payload of the answer, asking again for up to two seconds while the firmware is not ready."""
        request = encode_request(opcode, *parameters)
        for left in reversed(range(_ATTEMPTS)):
            try:
                self._device.write_control(DEPTH_UNIT, Selector.HARDWARE_MONITOR, request)
                answer = self._device.read_control(DEPTH_UNIT, Selector.HARDWARE_MONITOR, MESSAGE_BYTES)
                return decode_answer(answer, opcode, self._device.path)
            except (CameraNotReadyError, PortBusyError):
                if not left:
                    raise
                self._device.calls.sleep(_PAUSE_S)
        raise AssertionError("the last attempt returns or raises")

    def version(self) -> CameraVersion:
        """Firmware and serial numbers."""
        payload = self._ask_at_least(Opcode.VERSION, 70)
        firmware = ".".join(str(part) for part in reversed(payload[12:16]))
        return CameraVersion(firmware, payload[48:54].hex().upper(), payload[64:70].hex().upper())

    def depth_unit_m(self) -> float:
        """Metres per count of a depth image: a setting of the camera, 1 mm from the factory."""
        payload = self._ask_at_least(Opcode.ADVANCED_SETTINGS, 4, DEPTH_TABLE, 0)
        (unit_um,) = struct.unpack_from("<I", payload)
        if not 0 < unit_um <= 100_000:
            raise HardwareMonitorError(
                f"{self._device.path}: depth unit of {unit_um} um, expected 1 to 100000: reset the camera's settings"
            )
        return float(unit_um * 1e-6)

    def rectification(self) -> bytes:
        """Return intrinsics per image size, as drivers.d435_calibration reads them."""
        return self.ask(Opcode.RECTIFICATION)

    def coefficients(self) -> bytes:
        """Return calibration table 25, as drivers.d435_calibration reads it."""
        return self.ask(Opcode.TABLE, COEFFICIENTS_TABLE)

    def _ask_at_least(self, opcode: Opcode, size: int, *parameters: int) -> bytes:
        payload = self.ask(opcode, *parameters)
        if len(payload) < size:
            raise HardwareMonitorError(
                f"{self._device.path}: {opcode.name} answered with {len(payload)} bytes, expected {size}: replug it"
            )
        return payload
