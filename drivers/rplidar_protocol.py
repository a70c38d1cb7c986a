"""The RPLIDAR's requests and answers as bytes: builders, parsers and the tables they need. No state, no I/O.

Source: Slamtec, "RPLIDAR Interface Protocol and Application Notes", rev. 2.x; byte order is little endian throughout.
Measurement packets are in drivers.rplidar_capsules.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from functools import reduce
from operator import xor
from typing import Any

from drivers.errors import DeviceFaultError

SYNC = 0xA5
ANSWER_SYNC = b"\xa5\x5a"
DESCRIPTOR_BYTES = 7
DEFAULT_PWM = 660  # about 10 turns a second
MAX_PWM = 1023
PWM_SUPPORTED = 1  # bit of the accessory board's flags
FIRST_FIRMWARE_WITH_SAMPLE_RATE = (1, 17)
FIRST_FIRMWARE_WITH_CONF = (1, 24)


class Command(IntEnum):
    """Request codes; those with bit 7 carry a payload."""

    SCAN = 0x20
    FORCE_SCAN = 0x21
    STOP = 0x25
    RESET = 0x40
    GET_INFO = 0x50
    GET_HEALTH = 0x52
    GET_SAMPLERATE = 0x59
    EXPRESS_SCAN = 0x82
    GET_LIDAR_CONF = 0x84
    SET_PWM = 0xF0
    GET_ACC_BOARD_FLAG = 0xFF


class Answer(IntEnum):
    """Data types of response descriptors."""

    INFO = 0x04
    HEALTH = 0x06
    SAMPLERATE = 0x15
    CONF = 0x20
    NODES = 0x81
    EXPRESS = 0x82
    ULTRA = 0x84
    DENSE = 0x85
    ACC_BOARD_FLAG = 0xFF


class Conf(IntEnum):
    """Entries of GET_LIDAR_CONF; the four marked "of a mode" take the mode's id as payload."""

    ANGLE_RANGE = 0x00
    DESIRED_SPEED = 0x01
    COMMAND_BITMAP = 0x02
    MIN_ROTATION = 0x04
    MAX_ROTATION = 0x05
    MAX_DISTANCE = 0x60
    MODE_COUNT = 0x70
    MODE_SAMPLE_US = 0x71  # of a mode
    MODE_MAX_DISTANCE = 0x74  # of a mode
    MODE_ANSWER = 0x75  # of a mode
    TYPICAL_MODE = 0x7C
    MODE_NAME = 0x7F  # of a mode
    MAC = 0x79
    MODEL_REVISION = 0x80
    MODEL_ALIAS = 0x81
    DETECTED_BAUD = 0xA1


PACKET_BYTES = {Answer.NODES: 5, Answer.EXPRESS: 84, Answer.ULTRA: 132, Answer.DENSE: 84}
PACKET_SAMPLES = {Answer.NODES: 1, Answer.EXPRESS: 32, Answer.ULTRA: 96, Answer.DENSE: 40}


@dataclass(frozen=True, slots=True)
class Descriptor:
    """What announces an answer: payload size in bytes, whether packets repeat, and the data type."""

    size: int
    repeats: bool
    kind: int

    def encode(self) -> bytes:
        """The seven bytes on the wire."""
        return ANSWER_SYNC + struct.pack("<IB", self.size | int(self.repeats) << 30, self.kind)


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """GET_INFO: model byte (major << 4 | sub), firmware (major, minor), hardware revision, serial number in hex."""

    model_id: int
    firmware: tuple[int, int]
    hardware: int
    serial: str

    @property
    def model(self) -> str:
        """The name on the label, such as A2M8."""
        major, sub = divmod(self.model_id, 16)
        return f"A{major}M{sub}" if 1 <= major <= 3 else f"0x{self.model_id:02X}"

    @property
    def firmware_text(self) -> str:
        """Firmware as the vendor writes it, such as 1.28."""
        return f"{self.firmware[0]}.{self.firmware[1]:02d}"


@dataclass(frozen=True, slots=True)
class Health:
    """GET_HEALTH: status 0 good, 1 warning, 2 protection stop; the meaning of error codes is not published."""

    status: int
    error_code: int

    @property
    def stopped(self) -> bool:
        """True in protection stop: the device ignores scan requests until a reset clears it."""
        return self.status == 2


@dataclass(frozen=True, slots=True)
class SampleRate:
    """GET_SAMPLERATE: microseconds per sample of the two legacy modes."""

    standard_us: int
    express_us: int


@dataclass(frozen=True, slots=True)
class ScanMode:
    """One way to scan; ids are what the device enumerates, so look modes up by name."""

    id: int
    name: str
    sample_us: float
    max_distance_m: float
    answer_type: int

    @property
    def text(self) -> str:
        """Name, rate, range and answer type, for the user."""
        rate = 1e6 / self.sample_us
        return f"{self.name} ({rate:.0f} samples/s, {self.max_distance_m:g} m, 0x{self.answer_type:02X})"


def request(command: int, payload: bytes = b"") -> bytes:
    """Bytes of a request; those whose code has bit 7 carry length, payload and XOR checksum."""
    if not command & 0x80:
        return bytes((SYNC, command))
    body = bytes((SYNC, command, len(payload))) + payload
    return body + bytes((checksum(body),))


def checksum(data: bytes) -> int:
    """XOR of all bytes."""
    return reduce(xor, data, 0)


def express_request(mode_id: int) -> bytes:
    """Start a capsule mode; id 0 is the legacy express mode of every firmware."""
    return request(Command.EXPRESS_SCAN, struct.pack("<BHH", mode_id, 0, 0))


def pwm_request(pwm: int) -> bytes:
    """Set the motor's duty, 0 (stop) to 1023; ValueError outside."""
    if not 0 <= pwm <= MAX_PWM:
        raise ValueError(f"motor PWM {pwm} is out of range: use 0 (stop) to {MAX_PWM}; {DEFAULT_PWM} is about 10 Hz")
    return request(Command.SET_PWM, struct.pack("<H", pwm))


def accessory_flag_request() -> bytes:
    """Ask the USB accessory board for its features; a lidar wired without the board does not answer."""
    return request(Command.GET_ACC_BOARD_FLAG, bytes(4))


def conf_request(entry: Conf, mode_id: int | None = None) -> bytes:
    """Ask for one configuration entry, of a mode where mode_id is given."""
    payload = struct.pack("<I", entry) + (b"" if mode_id is None else struct.pack("<H", mode_id))
    return request(Command.GET_LIDAR_CONF, payload)


def find_descriptor(
    data: bytes, kind: int, *, repeats: bool = False, size: int | None = None
) -> tuple[Descriptor, int] | None:
    """Find the first descriptor of this kind in data that may begin with stale bytes; size None accepts any below 256.

    Returns it with the index of the first byte after it, or None when it has not (fully) arrived.
    """
    start = data.find(ANSWER_SYNC)
    while 0 <= start <= len(data) - DESCRIPTOR_BYTES:
        length, found = struct.unpack_from("<IB", data, start + 2)
        descriptor = Descriptor(length & 0x3FFFFFFF, length >> 30 == 1, found)
        wanted = descriptor.size < 256 if size is None else descriptor.size == size
        if wanted and length >> 30 == int(repeats) and found == kind:
            return descriptor, start + DESCRIPTOR_BYTES
        start = data.find(ANSWER_SYNC, start + 1)
    return None


def parse_info(payload: bytes) -> DeviceInfo:
    """GET_INFO's 20 bytes; the serial number is printed in byte order."""
    model, minor, major, hardware, serial = _unpack("<BBBB16s", payload, "GET_INFO")
    return DeviceInfo(model, (major, minor), hardware, serial.hex().upper())


def parse_health(payload: bytes) -> Health:
    """GET_HEALTH's 3 bytes."""
    return Health(*_unpack("<BH", payload, "GET_HEALTH"))


def parse_sample_rate(payload: bytes) -> SampleRate:
    """GET_SAMPLERATE's 4 bytes."""
    return SampleRate(*_unpack("<HH", payload, "GET_SAMPLERATE"))


def parse_u8(value: bytes, what: str) -> int:
    """An 8-bit configuration value; longer ones are read from their start, as the vendor's SDK does."""
    return int(_unpack("<B", value[:1], what)[0])


def parse_u16(value: bytes, what: str) -> int:
    """A 16-bit configuration value."""
    return int(_unpack("<H", value[:2], what)[0])


def parse_q8(value: bytes, what: str) -> float:
    """A 32-bit fixed-point configuration value with 8 fractional bits."""
    return float(_unpack("<I", value[:4], what)[0]) / 256.0


def parse_name(value: bytes) -> str:
    """A NUL-terminated name."""
    return value.split(b"\0", 1)[0].decode("ascii", "replace").strip()


def conf_value(payload: bytes, entry: Conf) -> bytes:
    """The value in a GET_LIDAR_CONF answer, which begins with the entry's number; DeviceFaultError for another's."""
    (echo,) = _unpack("<I", payload[:4], "GET_LIDAR_CONF")
    if echo != entry:
        raise DeviceFaultError(f"GET_LIDAR_CONF answered entry 0x{echo:02X}, asked for 0x{entry:02X}: reset the lidar")
    return payload[4:]


def _unpack(layout: str, payload: bytes, what: str) -> tuple[Any, ...]:
    expected = struct.calcsize(layout)
    if len(payload) != expected:
        raise DeviceFaultError(f"{what} answered {len(payload)} bytes, expected {expected}: reset or update the lidar")
    return struct.unpack(layout, payload)
