from __future__ import annotations

import contextlib
import os
import socket
import sys
import tty

import pytest

from drivers.errors import DeviceLostError, DriverError, PortBusyError, PortMissingError, PortPermissionError
from drivers.serial_link import open_serial

posix = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals need a POSIX system")


@pytest.fixture
def pair():
    """Master side and the slave's path of a raw pseudo-terminal."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        with contextlib.suppress(OSError):
            os.close(descriptor)


@posix
def test_bytes_both_ways_in_bulk(pair) -> None:
    master, name = pair
    link = open_serial(name, 256000)
    assert link.read(0.0) == b""
    link.write(b"\xa5\x25")
    assert os.read(master, 10) == b"\xa5\x25"
    os.write(master, bytes(range(256)))
    assert link.read(1.0) == bytes(range(256))
    link.set_dtr(False)  # a pseudo-terminal has no such line
    link.close()
    link.close()


@posix
def test_changing_speed_drops_old_input(pair) -> None:
    master, name = pair
    link = open_serial(name, 115200)
    os.write(master, b"old")
    link.set_baud(256000)
    os.write(master, b"new")
    assert link.read(1.0) == b"new"
    link.close()


@posix
def test_a_port_is_opened_once(pair) -> None:
    _, name = pair
    link = open_serial(name, 115200)
    with pytest.raises(PortBusyError, match=f"{name}: another process holds this port"):
        open_serial(name, 115200)
    link.close()
    open_serial(name, 115200).close()


@posix
def test_unplugged(pair) -> None:
    master, name = pair
    link = open_serial(name, 115200)
    os.close(master)
    with pytest.raises(DeviceLostError, match=f"{name}: the device went away while reading"):
        link.read(1.0)
    with pytest.raises(DeviceLostError, match="writing"):
        link.write(b"x")
    link.close()


def test_a_missing_port_names_those_that_exist() -> None:
    with pytest.raises(PortMissingError, match="/dev/ttyNone7: no such port; present: ") as caught:
        open_serial("/dev/ttyNone7", 115200)
    assert "\n" not in str(caught.value)


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may open everything")
def test_no_permission(tmp_path) -> None:
    port = tmp_path / "port"
    port.touch(mode=0)
    with pytest.raises(PortPermissionError, match="dialout"):
        open_serial(str(port), 115200)


@pytest.mark.parametrize("port", ["nosuch://scheme", "."])
def test_what_is_not_a_port(port: str) -> None:
    with pytest.raises(DriverError, match="expected a serial port or a pyserial URL"):
        open_serial(port, 115200)


@posix
@pytest.mark.parametrize("port", ["/dev/null", "."])
def test_a_file_or_folder_is_told_without_the_system_s_words(port: str) -> None:
    with pytest.raises(DriverError, match="no serial port") as caught:
        open_serial(port, 115200)
    assert "rrno" not in str(caught.value)
    assert "ioctl" not in str(caught.value)


def test_a_link_without_a_descriptor() -> None:
    link = open_serial("loop://", 115200)
    assert link.read(0.01) == b""
    link.write(b"hello")
    assert link.read(1.0) == b"hello"
    link.close()
    with pytest.raises(DeviceLostError):
        link.read(0.1)


def test_a_socket() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    link = open_serial(f"socket://127.0.0.1:{server.getsockname()[1]}", 115200)
    peer, _ = server.accept()
    peer.sendall(bytes(300))
    received = b""
    while len(received) < 300:
        received += link.read(2.0)
    assert received == bytes(300)
    peer.close()
    with pytest.raises(DeviceLostError):
        link.read(2.0)
    link.close()
    server.close()
