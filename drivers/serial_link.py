"""A serial port, or any other pyserial URL, as a byte link with typed errors."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select

import serial
from serial.tools import list_ports

from drivers.errors import (
    DeviceLostError,
    DriverError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
)

_READ_BYTES = 4096  # the size of the kernel's tty buffer: one read takes all that waits
_WRITE_TIMEOUT_S = 1.0
_NO_SUCH_LINE = (errno.ENOTTY, errno.EINVAL)  # what a pseudo-terminal answers when asked for a modem line


def open_serial(port: str, baud: int) -> SerialLink:
    """Open `port` (a path, a COM name or a pyserial URL) at `baud`, 8N1, with DTR and RTS cleared throughout.

    Clear before the open, because an RPLIDAR board takes an asserted DTR as "stop the motor". Raises PortMissingError,
    PortPermissionError, PortBusyError, or DriverError for anything else that keeps the port shut.
    """
    try:
        device = serial.serial_for_url(port, do_not_open=True)
        device.baudrate = baud
        device.timeout = 0
        device.write_timeout = _WRITE_TIMEOUT_S
        device.dtr = False
        device.rts = False
        device.exclusive = True
        device.open()
    except (OSError, ValueError) as error:  # SerialException is an OSError; ValueError: bad URL or speed
        raise _open_error(port, baud, error) from error
    return SerialLink(port, device)


class SerialLink:
    """An open port; see drivers.sources.ByteLink."""

    def __init__(self, port: str, device: serial.Serial) -> None:
        self.port = port
        self._device = device
        self._descriptor: int | None = None
        with contextlib.suppress(io.UnsupportedOperation):  # loop://, rfc2217:// and Windows have nothing to select on
            self._descriptor = device.fileno()

    def read(self, timeout_s: float) -> bytes:
        """Return all that has arrived, waiting up to timeout_s for the first byte; DeviceLostError if the port went."""
        try:
            if self._descriptor is None:
                return self._read_blocking(timeout_s)
            ready, _, _ = select.select([self._descriptor], [], [], timeout_s)
            return bytes(self._device.read(_READ_BYTES)) if ready else b""
        except (OSError, ValueError, TypeError) as error:  # the last two: closed by another thread meanwhile
            raise self._lost("reading", error) from error

    def write(self, data: bytes) -> None:
        """Send all of data; DeviceLostError if the port went or takes nothing for a second."""
        try:
            self._device.write(data)
        except (OSError, ValueError, TypeError) as error:
            raise self._lost("writing", error) from error

    def set_baud(self, baud: int) -> None:
        """Change the speed and drop what was received at the old one."""
        try:
            self._device.baudrate = baud
            self._device.reset_input_buffer()
        except ValueError as error:
            raise DriverError(f"{self.port}: this port cannot run at {baud} baud: try 115200 or 256000") from error
        except OSError as error:
            raise self._lost(f"changing to {baud} baud", error) from error

    def set_dtr(self, asserted: bool) -> None:
        """Set the DTR line; a link without one (a pseudo-terminal) ignores it."""
        try:
            self._device.dtr = asserted
        except OSError as error:
            if error.errno not in _NO_SUCH_LINE:
                raise self._lost("setting DTR", error) from error

    def close(self) -> None:
        """Release the port; closing twice, or after the device went, is allowed."""
        with contextlib.suppress(OSError):
            self._device.close()

    def _read_blocking(self, timeout_s: float) -> bytes:
        if self._device.timeout != timeout_s:
            self._device.timeout = timeout_s
        first = bytes(self._device.read(1))
        waiting = self._device.in_waiting if first else 0
        return first + bytes(self._device.read(waiting)) if waiting else first

    def _lost(self, action: str, error: Exception) -> DeviceLostError:
        return DeviceLostError(
            f"{self.port}: the device went away while {action} ({_one_line(error)}): check its cable and its 5 V supply"
        )


def _open_error(port: str, baud: int, error: Exception) -> DriverError:
    code = error.errno if isinstance(error, OSError) else None
    detail = _one_line(error)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or (code is None and "FileNotFoundError" in detail):
        present = ", ".join(_ports_present()) or "none"
        return PortMissingError(f"{port}: no such port; present: {present}: plug the device in or name one of these")
    if code in (errno.EACCES, errno.EPERM):
        return PortPermissionError(
            f"{port}: no permission to open it: join its group (`sudo usermod -aG dialout {_user()}`) and log in again"
        )
    if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in detail:
        return PortBusyError(f"{port}: another process holds this port: end it (`fuser -v {port}` names it)")
    if code in (errno.ENOTTY, errno.EISDIR) or f"({errno.ENOTTY}, " in detail:
        return DriverError(f"{port}: no serial port: expected a serial port or a pyserial URL, such as /dev/ttyUSB0")
    return DriverError(f"{port}: cannot be opened at {baud} baud ({detail}): expected a serial port or a pyserial URL")


def _ports_present() -> list[str]:
    return sorted(entry.device for entry in list_ports.comports())


def _user() -> str:
    return os.environ.get("USER", "$USER")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
