"""Serves an emulated device on a pseudo-terminal, so that any program can open it as a serial port. Linux only."""

from __future__ import annotations

import os
import select
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from drivers.emulated_link import EmulatedDevice
from drivers.errors import DriverError
from drivers.sources import Closing
from drivers.uart import misread

if sys.platform == "linux":
    import fcntl

_SERVICE_S = 0.005
_TCGETS2 = 0x802C542A
_TCSETS2 = 0x402C542B
_TERMIOS2 = struct.Struct("IIII B19s II")  # input, output, control, local flags, line, control characters, speeds
_RAW_CONTROL_FLAGS = 0o000060 | 0o000200 | 0o004000  # CS8 | CREAD | CLOCAL
_B115200, _ANY_SPEED = 0o010002, 0o010000  # programs that know no free speeds understand the first
_VMIN = 6  # index of a control character


class PtyPort(Closing):
    """Serves `device`, which talks at `baud`, on the path `.name` until closed; `link`: a symbolic link to that path.

    Clients come and go as on a real port: the device runs on, what nobody reads is lost (`bytes_lost`), and the line
    falls back to raw mode at the device's speed when the last client has left, so a client need not set anything.
    One that sets another speed gets, and sends, what a UART makes of it. Raises DriverError on other systems.
    """

    def __init__(
        self,
        device: EmulatedDevice,
        baud: int,
        *,
        link: Path | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if sys.platform != "linux":
            raise DriverError(
                f"emulated serial ports need Linux, this is {sys.platform}: use the in-memory link instead"
            )
        self._device = device
        self._baud = baud
        self._clock = clock
        self._link = link
        self.bytes_lost = 0
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self.plug_in()

    def plug_in(self) -> None:
        """Serve again after unplug(), on a new `.name`; a link leads there."""
        self._master, slave = os.openpty()
        self.name = os.ttyname(slave)
        os.set_blocking(self._master, False)
        _set_raw(self._master, self._baud)
        os.close(slave)
        if self._link is not None:
            self._place_link(self._link)
        self._had_client = False
        self._closing.clear()
        self._thread = threading.Thread(target=self._serve, name=f"pty {self.name}", daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Take the port away: clients get errors, the link is gone; nobody asks the device for anything any more."""
        self._closing.set()
        self._thread.join()
        if self._link is not None and self._link.is_symlink() and str(self._link.readlink()) == self.name:
            self._link.unlink()

    def close(self) -> None:
        """Unplug the device; raises what the device raised, if it did. Closing twice is allowed."""
        self.unplug()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _place_link(self, link: Path) -> None:
        if link.is_symlink() and (not link.exists() or str(link.readlink()).startswith("/dev/pts/")):
            link.unlink()  # left by an emulator that was killed
        try:
            link.symlink_to(self.name)
        except OSError as error:
            os.close(self._master)
            raise DriverError(
                f"{link}: cannot be made a link to {self.name} ({error.strerror}): name a free path"
            ) from error

    def _serve(self) -> None:
        poller = select.poll()
        poller.register(self._master, select.POLLIN)
        try:
            while not self._closing.is_set():
                events = dict(poller.poll(_SERVICE_S * 1000)).get(self._master, 0)
                self._tick(events)
                if events & select.POLLHUP:  # poll returns at once as long as nobody has the port open
                    self._closing.wait(_SERVICE_S)
        except Exception as error:  # noqa: BLE001 - handed to the owner, who learns of it in close()
            self._failure = error
        finally:
            os.close(self._master)  # the client sees the device vanish

    def _tick(self, events: int) -> None:
        if events & select.POLLHUP:
            if self._had_client:
                self._forget_client()
            self._had_client = False
            self.bytes_lost += len(self._device.due(self._clock()))
            return
        self._had_client = True
        host_baud = _speed(self._master)
        if events & select.POLLIN:
            heard = misread(self._read(), host_baud, self._baud)
            self._send(self._device.receive(heard, self._clock()), host_baud)
        self._send(self._device.due(self._clock()), host_baud)

    def _forget_client(self) -> None:
        """Give the line its settings back and drop what the client has not read."""
        _set_raw(self._master, self._baud)
        slave = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            while os.read(slave, 4096):
                pass
        except BlockingIOError:
            pass
        finally:
            os.close(slave)

    def _read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except OSError:  # the client left between the poll and here
            return b""

    def _send(self, data: bytes, host_baud: int) -> None:
        heard = misread(data, self._baud, host_baud)
        try:
            sent = os.write(self._master, heard) if heard else 0
        except BlockingIOError:
            sent = 0
        self.bytes_lost += len(heard) - sent


def _speed(descriptor: int) -> int:
    """Output speed that the client has set: on the master side the calls act on the client's line."""
    fields = _TERMIOS2.unpack(fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size)))
    return int(fields[-1])


def _set_raw(descriptor: int, baud: int) -> None:
    control_characters = bytearray(19)
    control_characters[_VMIN] = 1
    speed_flag = _B115200 if baud == 115200 else _ANY_SPEED
    fields = (0, 0, _RAW_CONTROL_FLAGS | speed_flag, 0, 0, bytes(control_characters), baud, baud)
    fcntl.ioctl(descriptor, _TCSETS2, _TERMIOS2.pack(*fields))
