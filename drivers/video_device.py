"""A V4L2 capture node: what it offers, mode and rate, streaming through mapped buffers, controls of extension units.

Knows nothing of depth. System calls are handed in, their errors come out typed.
"""

from __future__ import annotations

import contextlib
import mmap
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct
from typing import Any

from drivers import v4l2
from drivers.errors import DeviceFaultError, DeviceLostError, DriverError
from drivers.system_calls import SystemCalls
from drivers.video_errors import open_error, request_error


@dataclass(frozen=True, slots=True)
class Capability:
    """Who answers on a node, and what the node can do (flags CAP_* of drivers.v4l2)."""

    driver: str
    card: str
    bus: str
    flags: int


@dataclass(frozen=True, slots=True)
class ImageFormat:
    """The format that was agreed on; a line may be longer than its pixels."""

    width: int
    height: int
    bytes_per_line: int


@dataclass(frozen=True, slots=True)
class VideoMode:
    """An image size that the node offers, and its rates in Hz from low to high (none where the node does not tell)."""

    width: int
    height: int
    rates_hz: tuple[float, ...]

    def __str__(self) -> str:
        return f"{self.width}x{self.height}@{'/'.join(f'{rate:g}' for rate in self.rates_hz)}"


@dataclass(frozen=True, slots=True)
class FilledBuffer:
    """A buffer that the device has filled and that is ours until it is queued again; stamp_ns is its clock's."""

    index: int
    bytes_used: int
    flags: int
    stamp_ns: int
    sequence: int


class VideoDevice:
    """An open node. Raises PortMissingError, PortPermissionError, PortBusyError or DriverError where it stays shut.

    Every method raises DeviceLostError once the device is gone, PortBusyError where another process holds it, and
    DeviceFaultError for a request that the device refuses.
    """

    def __init__(self, path: str, calls: SystemCalls) -> None:
        self.path = path
        self.calls = calls
        try:
            self._descriptor: int | None = calls.open(path)
        except OSError as error:
            raise open_error(path, error) from error
        self._maps: list[mmap.mmap] = []
        self._streaming = False

    def capability(self) -> Capability:
        """Ask who answers; raises DriverError for a file that is not a video node."""
        try:
            driver, card, bus, _, whole, node = self._ask(v4l2.QUERYCAP, v4l2.CAPABILITY, (b"", b"", b"", 0, 0, 0), "")
        except DeviceFaultError as error:
            raise DriverError(f"{self.path}: not a video device: name a node such as /dev/video0") from error
        return Capability(_text(driver), _text(card), _text(bus), node if whole & v4l2.CAP_DEVICE_CAPS else whole)

    def formats(self) -> tuple[int, ...]:
        """Pixel formats of the node, as numbers."""
        head = v4l2.FORMAT_DESCRIPTION
        return tuple(
            entry[4] for entry in self._list(v4l2.ENUM_FMT, head, lambda i: (i, v4l2.TYPE_VIDEO_CAPTURE, 0, b"", 0))
        )

    def modes(self, pixel_format: int) -> tuple[VideoMode, ...]:
        """Image sizes of a pixel format with their rates; sizes given as ranges are left out."""
        sizes = [
            (width, height)
            for _, _, kind, width, height in self._list(
                v4l2.ENUM_FRAMESIZES, v4l2.FRAME_SIZE, lambda i: (i, pixel_format, 0, 0, 0)
            )
            if kind == v4l2.DISCRETE
        ]
        return tuple(VideoMode(width, height, self._rates_hz(pixel_format, width, height)) for width, height in sizes)

    def set_format(self, width: int, height: int, pixel_format: int) -> ImageFormat:
        """Choose size and pixel format; raises DeviceFaultError that lists the modes if the node gives another one."""
        wanted = (v4l2.TYPE_VIDEO_CAPTURE, width, height, pixel_format, v4l2.FIELD_NONE, 0, 0)
        answer = self._ask(v4l2.S_FMT, v4l2.IMAGE_FORMAT, wanted, f"choosing {width}x{height}")
        _, got_width, got_height, got_format, _, bytes_per_line, _ = answer
        if (got_width, got_height, got_format) != (width, height, pixel_format):
            raise self._not_offered(f"{width}x{height}", pixel_format)
        pixel_bytes = bytes_per_line or 2 * width  # 0 is what a node says that does not care
        return ImageFormat(width, height, pixel_bytes)

    def set_rate(self, fps: float, pixel_format: int) -> float | None:
        """Choose the rate of the format set before; return it, None where the node has no say in it."""
        interval = (v4l2.TYPE_VIDEO_CAPTURE, 0, 0, 1000, round(fps * 1000))
        try:
            answer = self._ask(v4l2.S_PARM, v4l2.STREAM_PARAMETERS, interval, f"choosing {fps:g} Hz")
        except DeviceFaultError:
            return None
        _, can, _, numerator, denominator = answer
        if not can & v4l2.CAP_TIMEPERFRAME or not numerator:
            return None
        rate_hz = float(denominator / numerator)
        if abs(rate_hz - fps) > 0.02 * fps:
            raise self._not_offered(f"{fps:g} Hz at this size", pixel_format)
        return rate_hz

    def start(self, buffers: int = 4) -> None:
        """Map buffers, hand them all to the device and begin to stream."""
        try:
            self._start(buffers)
        except BaseException:
            with contextlib.suppress(DriverError):
                self.stop()
            raise

    def wait(self, timeout_s: float) -> bool:
        """Wait for a filled buffer, or for the device to fail; False on time-out."""
        return self.calls.wait_readable(self._open_descriptor(), timeout_s)

    def take(self) -> FilledBuffer | None:
        """Take the oldest filled buffer; None if there is none yet."""
        try:
            answer = self._ask(v4l2.DQBUF, v4l2.BUFFER, _buffer(0), "reading")
        except BlockingIOError:
            return None
        index, _, used, flags, _, seconds, microseconds, sequence, *_ = answer
        return FilledBuffer(index, used, flags, seconds * 1_000_000_000 + microseconds * 1000, sequence)

    def content(self, buffer: FilledBuffer) -> mmap.mmap:
        """Return the memory of a taken buffer; views of it must be gone before stop()."""
        return self._maps[buffer.index]

    def queue(self, index: int) -> None:
        """Hand a buffer to the device."""
        self._ask(v4l2.QBUF, v4l2.BUFFER, _buffer(index), "giving a buffer back")

    def stop(self) -> None:
        """End the stream and release the buffers; a second call is allowed."""
        was_streaming, self._streaming = self._streaming, False
        maps, self._maps = self._maps, []
        try:
            if was_streaming:
                self._ask(v4l2.STREAMOFF, v4l2.BUFFER_TYPE, (v4l2.TYPE_VIDEO_CAPTURE,), "stopping the stream")
        finally:
            for each in maps:
                with contextlib.suppress(BufferError):  # still viewed by someone: released with the view
                    each.close()
        if maps:
            none = (0, v4l2.TYPE_VIDEO_CAPTURE, v4l2.MEMORY_MMAP)
            self._ask(v4l2.REQBUFS, v4l2.REQUEST_BUFFERS, none, "releasing the buffers")

    def close(self) -> None:
        """Stop and release the node; a lost device and a second call are fine."""
        with contextlib.suppress(DriverError):
            self.stop()
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with contextlib.suppress(OSError):
                self.calls.close(descriptor)

    def read_control(self, unit: int, selector: int, size: int, query: int = v4l2.UVC_GET_CUR) -> bytes:
        """Read `size` bytes of a control of a UVC extension unit: its value, or its bounds by another query."""
        data = array("B", bytes(size))
        self._control(unit, selector, query, data)
        return data.tobytes()

    def write_control(self, unit: int, selector: int, value: bytes) -> None:
        """Set a control of a UVC extension unit."""
        self._control(unit, selector, v4l2.UVC_SET_CUR, array("B", value))

    def _start(self, buffers: int) -> None:
        count, _, _ = self._ask(
            v4l2.REQBUFS,
            v4l2.REQUEST_BUFFERS,
            (buffers, v4l2.TYPE_VIDEO_CAPTURE, v4l2.MEMORY_MMAP),
            "asking for buffers",
        )
        if count < 2:
            raise DeviceFaultError(
                f"{self.path}: gives {count} buffers, expected at least 2: free memory and try again"
            )
        for index in range(count):
            found = self._ask(v4l2.QUERYBUF, v4l2.BUFFER, _buffer(index), "asking for a buffer")
            self._maps.append(self._map(length=found[10], offset=found[9]))
            self.queue(index)
        self._ask(v4l2.STREAMON, v4l2.BUFFER_TYPE, (v4l2.TYPE_VIDEO_CAPTURE,), "starting the stream")
        self._streaming = True

    def _control(self, unit: int, selector: int, query: int, data: array[int]) -> None:
        address, length = data.buffer_info()
        fields = (unit, selector, query, length, address)
        self._ask(v4l2.UVC_CONTROL_QUERY, v4l2.EXTENSION_QUERY, fields, f"control {selector} of unit {unit}")

    def _rates_hz(self, pixel_format: int, width: int, height: int) -> tuple[float, ...]:
        entries = self._list(
            v4l2.ENUM_FRAMEINTERVALS, v4l2.FRAME_INTERVAL, lambda i: (i, pixel_format, width, height, 0, 0, 0)
        )
        return tuple(sorted(entry[6] / entry[5] for entry in entries if entry[4] == v4l2.DISCRETE and entry[5]))

    def _not_offered(self, wanted: str, pixel_format: int) -> DeviceFaultError:
        offered = ", ".join(str(mode) for mode in self.modes(pixel_format)) or "unknown"
        return DeviceFaultError(
            f"{self.path}: {wanted} is not offered; offered: {offered}: choose one of these"
            " (a USB 2 port or cable offers far fewer than USB 3)"
        )

    def _list(self, request: int, layout: Struct, fields: Any) -> Iterator[tuple[Any, ...]]:
        """Yield the entries of an enumeration, which ends with EINVAL (ENOTTY where the node has none)."""
        for index in range(256):
            try:
                yield self._ask(request, layout, fields(index), "listing what it offers")
            except DeviceFaultError:
                return

    def _map(self, length: int, offset: int) -> mmap.mmap:
        try:
            return self.calls.mmap(self._open_descriptor(), length, offset)
        except OSError as error:
            raise request_error(self.path, "mapping a buffer", error) from error

    def _ask(self, request: int, layout: Struct, fields: tuple[Any, ...], action: str) -> tuple[Any, ...]:
        argument = bytearray(layout.pack(*fields))
        try:
            self.calls.ioctl(self._open_descriptor(), request, argument)
        except BlockingIOError:
            raise
        except OSError as error:
            raise request_error(self.path, action, error, streaming=self._streaming) from error
        return layout.unpack(argument)

    def _open_descriptor(self) -> int:
        if self._descriptor is None:
            raise DeviceLostError(f"{self.path}: the camera is closed: open it again")
        return self._descriptor


def _buffer(index: int) -> tuple[int, ...]:
    return (index, v4l2.TYPE_VIDEO_CAPTURE, 0, 0, 0, 0, 0, 0, v4l2.MEMORY_MMAP, 0, 0)


def _text(field: bytes) -> str:
    return field.split(b"\0", 1)[0].decode("utf-8", errors="replace")
