"""Where a MAVLink vehicle is found, as text: `serial:/dev/ttyTHS1:921600`, `udp:127.0.0.1:14550`, `tcp:HOST:PORT`.

| text | meaning |
|---|---|
| `serial:PATH[:BAUD]`, `/dev/...[:BAUD]` | a serial port, 57600 baud unless told |
| `serial:URL` | any pyserial URL, such as `serial:rfc2217://host:2000` |
| `udp:HOST:PORT`, `udpin:HOST:PORT` | wait there for the vehicle's packets, as ground stations do |
| `udpout:HOST:PORT` | send there |
| `tcp:HOST:PORT` | connect to it |
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.datagram_link import DatagramLink
from drivers.serial_link import open_serial
from drivers.sources import ByteLink

_USUAL_BAUD = 57600
_NETWORKS = ("udp", "udpin", "udpout", "tcp")
_WRITE_TIMEOUT_S = 0.004  # a command that cannot leave by then is dropped: the next is on its way


class AddressError(ValueError):
    """The text is no address; its message is one line for the user."""


@dataclass(frozen=True, slots=True)
class MavlinkAddress:
    """kind: serial, udp, udpin, udpout or tcp; place: a path, a pyserial URL or a host; number: baud or port."""

    kind: str
    place: str
    number: int

    @property
    def bytes_per_s(self) -> float | None:
        """What a serial line can carry; None: a network carries what we send."""
        return self.number / 10.0 if self.kind == "serial" and "://" not in self.place else None

    def open(self) -> ByteLink:
        """Open the way to the vehicle; raises DriverError."""
        if self.kind == "serial":
            return open_serial(self.place, self.number, write_timeout_s=_WRITE_TIMEOUT_S)
        if self.kind == "tcp":
            return open_serial(f"socket://{self.place}:{self.number}", _USUAL_BAUD, write_timeout_s=_WRITE_TIMEOUT_S)
        return DatagramLink(self.place, self.number, listen=self.kind != "udpout")

    def __str__(self) -> str:
        if "://" in self.place:
            return f"{self.kind}:{self.place}"
        return f"{self.kind}:{self.place}:{self.number}"


def parse_address(text: str) -> MavlinkAddress:
    """Read an address as the module describes it; raises AddressError."""
    kind, _, rest = text.partition(":")
    if text.startswith("/"):
        kind, rest = "serial", text
    if kind == "serial" and rest:
        place, colon, number = rest.rpartition(":")
        if "://" in rest or not colon:
            return MavlinkAddress(kind, rest, _USUAL_BAUD)
        if place and number.isdecimal() and 0 < int(number) <= 4_000_000:
            return MavlinkAddress(kind, place, int(number))
        raise AddressError(f"vehicle {text!r}: {number!r} is no speed, such as 57600 or 921600")
    host, _, number = rest.rpartition(":")
    if kind in _NETWORKS and host and number.isdecimal() and int(number) < 65536:
        return MavlinkAddress(kind, host, int(number))
    raise AddressError(
        f"vehicle {text!r}: expected serial:PATH[:BAUD], udp:HOST:PORT (listens), udpout:HOST:PORT or tcp:HOST:PORT"
    )
