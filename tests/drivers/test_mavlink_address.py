"""Addresses as text, and what they open."""

import socket

import pytest

from drivers.datagram_link import DatagramLink
from drivers.errors import DriverError, PortMissingError
from drivers.mavlink_address import AddressError, MavlinkAddress, parse_address


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("serial:/dev/ttyTHS1:921600", MavlinkAddress("serial", "/dev/ttyTHS1", 921600)),
        ("serial:/dev/ttyACM0", MavlinkAddress("serial", "/dev/ttyACM0", 57600)),
        ("/dev/ttyACM0:115200", MavlinkAddress("serial", "/dev/ttyACM0", 115200)),
        ("serial:rfc2217://box:2000", MavlinkAddress("serial", "rfc2217://box:2000", 57600)),
        ("udp:127.0.0.1:14550", MavlinkAddress("udp", "127.0.0.1", 14550)),
        ("udpout:car.local:14550", MavlinkAddress("udpout", "car.local", 14550)),
        ("tcp:127.0.0.1:5760", MavlinkAddress("tcp", "127.0.0.1", 5760)),
    ],
)
def test_reads(text: str, address: MavlinkAddress) -> None:
    assert parse_address(text) == address
    assert parse_address(str(address)) == address


@pytest.mark.parametrize("text", ["", "serial:", "serial:/dev/x:fast", "udp:14550", "udp:host:99999", "car:1:2"])
def test_refuses_in_one_line(text: str) -> None:
    with pytest.raises(AddressError, match="vehicle") as caught:
        parse_address(text)
    assert "\n" not in str(caught.value)


def test_only_a_serial_line_is_narrow() -> None:
    assert parse_address("/dev/ttyACM0:57600").bytes_per_s == 5760
    assert parse_address("udp:127.0.0.1:1").bytes_per_s is None


def test_opens_udp_and_tcp() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = parse_address(f"tcp:127.0.0.1:{server.getsockname()[1]}").open()
        link.write(b"there")
        far_end, _ = server.accept()
        with far_end:
            assert far_end.recv(5) == b"there"
            far_end.sendall(b"back")
            assert link.read(1.0) == b"back"
        link.close()
    udp = parse_address("udp:127.0.0.1:0").open()
    assert isinstance(udp, DatagramLink)
    udp.close()


def test_what_is_not_there_is_told() -> None:
    with pytest.raises(PortMissingError, match="no such port"):
        parse_address("serial:/dev/no-such-port:57600").open()
    with pytest.raises(DriverError, match="cannot be opened"):
        parse_address("tcp:127.0.0.1:1").open()
