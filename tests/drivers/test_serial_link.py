from __future__ import annotations

import contextlib
import grp
import os
import socket
import sys
import termios
import threading
import time
import tty

import pytest
import serial
from serial import rfc2217

from drivers.errors import (
    DeviceLostError,
    DriverError,
    LinkFullError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
)
from drivers.serial_link import open_serial, usb_adapter

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
def test_closing_leaves_the_modem_lines_as_they_are(pair) -> None:
    _, name = pair
    other = os.open(name, os.O_RDWR | os.O_NOCTTY)
    link = open_serial(name, 115200)
    link.set_baud(256000)
    assert not termios.tcgetattr(other)[2] & termios.HUPCL
    link.set_rts(True)  # a pseudo-terminal has no such line either
    link.close()
    os.close(other)


@posix
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may open everything")
def test_no_permission(tmp_path) -> None:
    port = tmp_path / "port"
    port.touch(mode=0)
    group = grp.getgrgid(port.stat().st_gid).gr_name
    with pytest.raises(PortPermissionError, match=f"-aG {'dialout' if group == 'root' else group} "):
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


class NetworkPort:
    """An RFC 2217 server with a loop:// port behind it, for one client."""

    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self.server.getsockname()[1]}"
        self.port = serial.serial_for_url("loop://", baudrate=115200, timeout=0.01)
        self.client: socket.socket | None = None
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def serve(self) -> None:
        self.client, _ = self.server.accept()
        self.client.settimeout(0.01)
        manager = rfc2217.PortManager(self.port, self)  # type: ignore[arg-type]  # anything with write(data) will do
        while self.thread.is_alive():
            try:
                data = self.client.recv(1024)
            except TimeoutError:
                data = b""
            except OSError:
                return
            self.port.write(b"".join(manager.filter(data)))
            waiting = self.port.read(self.port.in_waiting)
            if waiting:
                self.write(b"".join(manager.escape(waiting)))

    def write(self, data: bytes) -> None:
        assert self.client is not None
        self.client.sendall(data)

    def close(self) -> None:
        if self.client is not None:
            self.client.shutdown(socket.SHUT_RDWR)
            self.client.close()
        self.server.close()
        self.thread.join()


def read_often(link) -> None:
    """A busy computer takes its time to tell that the other end is gone."""
    for _ in range(10):
        link.read(2.0)


@pytest.mark.filterwarnings("ignore:set:DeprecationWarning")  # pyserial 3.5 under Python 3.10 and later
def test_a_port_on_the_network() -> None:
    far = NetworkPort()
    link = open_serial(far.url, 115200)
    link.set_baud(256000)
    assert far.port.baudrate == 256000
    link.set_dtr(False)
    link.write(b"\xa5\xff\x50")
    heard = b""
    while len(heard) < 3:
        heard += link.read(2.0)
    assert heard == b"\xa5\xff\x50"
    far.close()
    with pytest.raises(DeviceLostError):
        read_often(link)
    link.close()


@posix
def test_a_pseudo_terminal_is_no_usb_adapter(pair) -> None:
    assert usb_adapter(pair[1]) is None


@posix
def test_a_port_that_takes_nothing_says_so_in_time(pair) -> None:
    _, name = pair
    link = open_serial(name, 115200, write_timeout_s=0.004)
    began = time.perf_counter()
    with pytest.raises(LinkFullError, match="takes no more bytes"):
        link.write(bytes(200_000))
    assert time.perf_counter() - began < 1.0
    link.close()
