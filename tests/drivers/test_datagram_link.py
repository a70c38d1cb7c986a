"""UDP as a byte link, on this computer."""

import pytest

from drivers.datagram_link import DatagramLink
from drivers.errors import DeviceLostError, PortBusyError, PortMissingError


def test_there_and_back() -> None:
    with DatagramLink("127.0.0.1", 0, listen=True) as here, DatagramLink("127.0.0.1", here.port, listen=False) as there:
        here.write(b"to nobody yet")
        there.write(b"hello ")
        there.write(b"you")
        received = here.read(1.0)
        while len(received) < 9:
            received += here.read(1.0)
        assert received == b"hello you"
        here.write(b"back")
        assert there.read(1.0) == b"back"
        assert here.read(0.0) == b""


def test_a_far_end_that_is_not_there_yet_is_no_error() -> None:
    with DatagramLink("127.0.0.1", 0, listen=True) as gone:
        port = gone.port
    with DatagramLink("127.0.0.1", port, listen=False) as there:
        for _ in range(3):
            there.write(b"anybody?")
            assert there.read(0.01) == b""
        with DatagramLink("127.0.0.1", port, listen=True) as here:
            there.write(b"now")
            assert here.read(1.0) == b"now"


def test_typed_errors() -> None:
    with DatagramLink("127.0.0.1", 0, listen=True) as here:
        with pytest.raises(PortBusyError, match="another program listens"):
            DatagramLink("127.0.0.1", here.port, listen=True)
        here.close()
        with pytest.raises(DeviceLostError, match="closed"):
            here.read(0.0)
    with pytest.raises(PortMissingError, match="no such address"):
        DatagramLink("192.0.2.1", 0, listen=True)
