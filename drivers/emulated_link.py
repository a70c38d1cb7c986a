"""A link to an emulated device without an operating system between: simulated time, the same bytes on every run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.errors import DeviceLostError
from drivers.uart import misread

_TICK_NS = 1_000_000


class EmulatedDevice(Protocol):
    """What sits at the far end of an emulated wire."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Take bytes from the host; return what is answered at once."""
        ...

    def due(self, now_ns: int) -> bytes:
        """Return what the device has sent of its own accord since the last call."""
        ...


class PoweredDevice(EmulatedDevice, Protocol):
    """A device that gets its supply through the same plug."""

    def power_up(self, now_ns: int) -> None:
        """Start anew, as after plugging in."""
        ...


class SimulatedClock:
    """Time that passes only when it is told to; call it for ns."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        """Return the time in ns."""
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.now_ns += round(seconds * 1e9)


class EmulatedLink:
    """A drivers.sources.ByteLink to a device that talks at device_baud; waiting in read lets simulated time pass.

    on_line: is told the name and the state of each modem line that the host sets.
    """

    def __init__(
        self,
        device: EmulatedDevice,
        clock: SimulatedClock,
        device_baud: int,
        baud: int,
        *,
        on_line: Callable[[str, bool], None] = lambda _line, _asserted: None,
    ) -> None:
        self._device = device
        self._clock = clock
        self._device_baud = device_baud
        self._baud = baud
        self._on_line = on_line
        self._received = b""
        self._unplugged = False
        self.closed = False

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, letting up to timeout_s pass in steps of 1 ms for the first byte."""
        deadline_ns = self._clock() + round(timeout_s * 1e9)
        self._collect()
        while not self._received and (left_ns := deadline_ns - self._clock()) > 0:
            self._clock.now_ns += min(_TICK_NS, left_ns)
            self._collect()
        data, self._received = self._received, b""
        return data

    def write(self, data: bytes) -> None:
        """Send all of data; at another speed than the device's it is noise there."""
        self._collect()
        heard = misread(data, self._baud, self._device_baud)
        self._hear(self._device.receive(heard, self._clock()))

    def set_baud(self, baud: int) -> None:
        """Change the speed and drop what was received at the old one."""
        self._collect()
        self._baud, self._received = baud, b""

    def set_dtr(self, asserted: bool) -> None:
        """Tell whoever listens to the modem lines."""
        self._on_line("dtr", asserted)

    def set_rts(self, asserted: bool) -> None:
        """Likewise."""
        self._on_line("rts", asserted)

    def close(self) -> None:
        """Release the link; the device runs on."""
        self.closed = True

    def unplug(self) -> None:
        """From now on reading and writing raise DeviceLostError."""
        self._unplugged = True

    def _collect(self) -> None:
        if self._unplugged or self.closed:
            raise DeviceLostError("emulated lidar: unplugged or closed: connect again")
        self._hear(self._device.due(self._clock()))

    def _hear(self, sent: bytes) -> None:
        self._received += misread(sent, self._device_baud, self._baud)
