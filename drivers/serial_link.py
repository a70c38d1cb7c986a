"""A serial port, or any other pyserial URL, as a byte link with typed errors."""

from __future__ import annotations

import contextlib
import errno
import grp
import io
import os
import select
import termios
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from drivers.errors import (
    DeviceLostError,
    DriverError,
    LinkFullError,
    PortBusyError,
    PortMissingError,
    PortPermissionError,
)
from drivers.sources import Closing

_USUAL_GROUP = "dialout"
_READ_BYTES = 4096  # the size of the kernel's tty buffer: one read takes all that waits
_WRITE_TIMEOUT_S = 1.0
_NO_SUCH_LINE = (errno.ENOTTY, errno.EINVAL)  # what a pseudo-terminal answers when asked for a modem line


def open_serial(port: str, baud: int, *, write_timeout_s: float = _WRITE_TIMEOUT_S) -> SerialLink:
    """Open `port` (a path, a COM name or a pyserial URL) at `baud`, 8N1, with DTR and RTS cleared throughout.

    write_timeout_s: how long a write waits for room before it raises LinkFullError.
    Clear before the open, because an RPLIDAR board takes an asserted DTR as "stop the motor". Raises PortMissingError,
    PortPermissionError, PortBusyError, or DriverError for anything else that keeps the port shut.
    """
    try:
        device = serial.serial_for_url(port, do_not_open=True)
        device.baudrate = baud
        device.timeout = 0
        if not port.lower().startswith("rfc2217:"):  # pyserial refuses it there
            device.write_timeout = write_timeout_s
        device.dtr = False
        device.rts = False
        device.exclusive = True
        device.open()
    except (OSError, ValueError) as error:  # SerialException is an OSError; ValueError: bad URL or speed
        raise _open_error(port, baud, error) from error
    return SerialLink(port, device)


class SerialLink(Closing):
    """An open port; see drivers.sources.ByteLink."""

    def __init__(self, port: str, device: serial.Serial) -> None:
        self.port = port
        self._device = device
        self._descriptor: int | None = None
        with contextlib.suppress(io.UnsupportedOperation):  # loop:// and rfc2217:// have nothing to select on
            self._descriptor = device.fileno()
        if self._descriptor is not None:
            _keep_lines(self._descriptor)

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
        """Send all of data; DeviceLostError if the port went, and its kind LinkFullError if it takes nothing."""
        try:
            self._device.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkFullError(
                f"{self.port}: takes no more bytes: check its speed, and that the device is switched on"
            ) from error
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
        self._set_line("dtr", asserted)

    def set_rts(self, asserted: bool) -> None:
        """Set the RTS line, likewise."""
        self._set_line("rts", asserted)

    def close(self) -> None:
        """Release the port; closing twice, or after the device went, is allowed."""
        network = getattr(self._device, "_socket", None)
        with contextlib.suppress(OSError):
            self._device.close()
        if network is not None:
            network.close()  # pyserial 3.5 leaves it open when the far end has gone

    def _set_line(self, name: str, asserted: bool) -> None:
        try:
            setattr(self._device, name, asserted)
        except OSError as error:
            if error.errno not in _NO_SUCH_LINE:
                raise self._lost(f"setting {name.upper()}", error) from error

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


def _keep_lines(descriptor: int) -> None:
    """Let the modem lines stay as they are on closing: a dropped DTR would turn a bare board's motor on again."""
    with contextlib.suppress(termios.error):  # a socket has none
        settings = termios.tcgetattr(descriptor)
        settings[2] &= ~termios.HUPCL
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)


def _open_error(port: str, baud: int, error: Exception) -> DriverError:
    code = error.errno if isinstance(error, OSError) else None
    detail = _one_line(error)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or (code is None and "FileNotFoundError" in detail):
        present = ", ".join(_ports_present()) or "none"
        return PortMissingError(f"{port}: no such port; present: {present}: plug the device in or name one of these")
    if code in (errno.EACCES, errno.EPERM):
        group = _group(port)
        return PortPermissionError(
            f"{port}: no permission to open it: join its group (`sudo usermod -aG {group} {_user()}`) and log in again"
        )
    if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in detail:
        return PortBusyError(f"{port}: another process holds this port: end it (`fuser -v {port}` names it)")
    if code in (errno.ENOTTY, errno.EISDIR) or f"({errno.ENOTTY}, " in detail:
        return DriverError(f"{port}: no serial port: expected a serial port or a pyserial URL, such as /dev/ttyUSB0")
    return DriverError(f"{port}: cannot be opened at {baud} baud ({detail}): expected a serial port or a pyserial URL")


@dataclass(frozen=True, slots=True)
class UsbAdapter:
    """The USB side of a serial port: vendor and product id, and the serial number if it has one."""

    vendor: int
    product: int
    serial_number: str | None


def usb_adapter(port: str) -> UsbAdapter | None:
    """The adapter at a port (a path, links are followed); None where there is none."""
    device = str(Path(port).resolve())
    for entry in list_ports.comports():
        if entry.device == device and entry.vid is not None and entry.pid is not None:
            return UsbAdapter(entry.vid, entry.pid, entry.serial_number)
    return None


def _ports_present() -> list[str]:
    return sorted(entry.device for entry in list_ports.comports())


def _group(port: str) -> str:
    """Return the group that may open the port: its own, or what udev gives serial ports where it is only root's."""
    try:
        name = grp.getgrgid(Path(port).stat().st_gid).gr_name
    except (OSError, KeyError):
        return _USUAL_GROUP
    return _USUAL_GROUP if name == "root" else name


def _user() -> str:
    return os.environ.get("USER", "$USER")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
