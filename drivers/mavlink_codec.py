"""MAVLink 2 packets and bytes, by pymavlink: the one file that knows it.

pymavlink is imported when a codec is made, since most commands need none. Its messages have fields as attributes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from drivers.errors import DriverError

MavlinkMessage = Any  # a pymavlink message: get_type(), get_srcSystem(), get_srcComponent(), fields


class MavlinkCodec:
    """Packs messages as `system` and `component`, and finds messages in received bytes, however those are cut.

    bytes_bad: received bytes that are part of no message, among them all of packets with a wrong checksum.
    Raises DriverError where pymavlink is missing.
    """

    def __init__(self, system: int, component: int) -> None:
        dialect = _dialect()
        self.system, self.component = system, component
        self._messages = {kind.msgname: kind for kind in dialect.mavlink_map.values()}
        self._packer = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True  # damaged packets are counted, not raised
        self.bytes_bad = 0

    def encode(self, name: str, /, **fields: object) -> bytes:
        """Return a message such as HEARTBEAT as one packet."""
        message = self._messages[name](**fields)
        packet = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        return packet

    def decode(self, data: bytes) -> list[MavlinkMessage]:
        """Return the messages that are complete with these bytes."""
        found = []
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.bytes_bad += len(message.data)
            elif not message.get_type().startswith("UNKNOWN_"):
                found.append(message)
        return found


def read_telemetry_log(data: bytes) -> Iterator[tuple[int, MavlinkMessage]]:
    """Yield stamps in ns of the epoch and messages of a .tlog: each packet stands behind 8 bytes, big-endian us.

    Bytes that are neither are stepped over.
    """
    dialect = _dialect()
    parser = dialect.MAVLink(None)
    place = 0
    while place + 16 <= len(data):
        size = _packet_size(data, place + 8)
        if size is None or place + 8 + size > len(data):
            place += 1
            continue
        try:
            message = parser.decode(bytearray(data[place + 8 : place + 8 + size]))
        except dialect.MAVError:
            place += 1
            continue
        yield int.from_bytes(data[place : place + 8], "big") * 1000, message
        place += 8 + size


def _packet_size(data: bytes, place: int) -> int | None:
    """Return the length of the MAVLink 1 or 2 packet that begins at `place`, None where none does."""
    length = data[place + 1]
    if data[place] == 0xFE:
        return length + 8
    return length + 12 + 13 * (data[place + 2] & 1) if data[place] == 0xFD else None


def _dialect() -> Any:
    try:
        from pymavlink.dialects.v20 import ardupilotmega  # noqa: PLC0415 - see above
    except ImportError as error:
        raise DriverError(f"MAVLink needs pymavlink ({error}): pip install 'pymavlink>=2.4.40'") from error
    return ardupilotmega
