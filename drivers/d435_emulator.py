"""A D435 in software, below the system calls: hand it to the driver instead of the real ones, nothing else changes.

Memory stands for the mapped buffers, and requests are answered as uvcvideo does, wrong ones with its errno. Not
imitated: the infrared, colour and metadata nodes, automatic exposure, the temperature of the projector, USB bandwidth;
optical noise belongs into the images.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import time
from collections.abc import Callable
from enum import Enum
from struct import Struct
from typing import Any

from drivers import v4l2
from drivers.d435_emulated_firmware import USB3_MODES, EmulatedFirmware
from drivers.d435_emulated_stream import EmulatedStream, FrameSupply, Images, StreamFaults

CARD = b"Intel(R) RealSense(TM) Depth Ca"  # as the kernel cuts it
_DESCRIPTOR = 1000
_UNIT = 3
_LEAST_WAIT_S = 1e-4
_NO_FAULTS = StreamFaults()


class NodeState(Enum):
    """What happens to who opens the node or wants to stream from it."""

    PRESENT = "present"
    MISSING = "missing"
    FORBIDDEN = "forbidden"
    BUSY = "busy"  # it opens, but another process streams


class D435Emulator:
    """A camera on `path` that shows `images`; see drivers.system_calls.SystemCalls for its methods.

    images: uint16 images of the mode's shape, in order, or a function from a stamp (ns of `clock`) to one. They come at
    the rate that the driver sets or, with free_running, as fast as they are taken. clock and sleep: real time, or a
    SimulatedClock's. One process, one descriptor at a time.
    """

    def __init__(
        self,
        images: Images,
        *,
        path: str = "/dev/video0",
        firmware: EmulatedFirmware | None = None,
        faults: StreamFaults = _NO_FAULTS,
        free_running: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.path = path
        self.firmware = EmulatedFirmware() if firmware is None else firmware
        self.state = NodeState.PRESENT
        self._supply = FrameSupply(images)
        self._faults = faults
        self._free_running = free_running
        self._clock = clock
        self._sleep = sleep
        self._opened = False
        self._size = (848, 480)
        self._fps = 30
        self._buffers: list[mmap.mmap] = []
        self._given: list[int] = []  # buffers handed over before the stream began
        self._stream: EmulatedStream | None = None
        self._answers: dict[int, tuple[Struct, Callable[..., tuple[Any, ...]]]] = {
            v4l2.QUERYCAP: (v4l2.CAPABILITY, self._capability),
            v4l2.ENUM_FMT: (v4l2.FORMAT_DESCRIPTION, self._format),
            v4l2.ENUM_FRAMESIZES: (v4l2.FRAME_SIZE, self._frame_size),
            v4l2.ENUM_FRAMEINTERVALS: (v4l2.FRAME_INTERVAL, self._frame_interval),
            v4l2.S_FMT: (v4l2.IMAGE_FORMAT, self._set_format),
            v4l2.S_PARM: (v4l2.STREAM_PARAMETERS, self._set_rate),
            v4l2.REQBUFS: (v4l2.REQUEST_BUFFERS, self._request_buffers),
            v4l2.QUERYBUF: (v4l2.BUFFER, self._query_buffer),
            v4l2.QBUF: (v4l2.BUFFER, self._queue),
            v4l2.DQBUF: (v4l2.BUFFER, self._dequeue),
            v4l2.STREAMON: (v4l2.BUFFER_TYPE, self._stream_on),
            v4l2.STREAMOFF: (v4l2.BUFFER_TYPE, self._stream_off),
            v4l2.UVC_CONTROL_QUERY: (v4l2.EXTENSION_QUERY, self._control),
        }

    @property
    def overruns(self) -> int:
        """Frames of the present stream for which no buffer waited."""
        return self._stream.overruns if self._stream is not None else 0

    def unplug(self) -> None:
        """Pull the cable: what is open fails with ENODEV, and the node is gone until plug_in()."""
        self.state = NodeState.MISSING
        self._stream = None

    def plug_in(self) -> None:
        """Bring the node back, with a firmware that has kept its state."""
        self.state = NodeState.PRESENT
        self._opened = False

    def open(self, path: str) -> int:
        """Open the node; any other path does not exist."""
        if path != self.path or self.state is NodeState.MISSING:
            raise _system_error(errno.ENOENT)
        if self.state is NodeState.FORBIDDEN:
            raise _system_error(errno.EACCES)
        if self._opened:
            raise _system_error(errno.EMFILE)
        self._opened = True
        return _DESCRIPTOR

    def close(self, descriptor: int) -> None:
        """Close it, which ends a stream."""
        self._require_open(descriptor)
        self._opened = False
        self._stream = None
        self._buffers, self._given = [], []

    def ioctl(self, descriptor: int, request: int, argument: bytearray) -> None:
        """Answer a request as uvcvideo does."""
        self._require_open(descriptor)
        self._require_plugged()
        if request not in self._answers:
            raise _system_error(errno.ENOTTY)
        layout, answer = self._answers[request]
        layout.pack_into(argument, 0, *answer(*layout.unpack(argument)))

    def mmap(self, descriptor: int, length: int, offset: int) -> mmap.mmap:
        """Return the memory of a buffer."""
        self._require_open(descriptor)
        index, rest = divmod(offset, self._image_bytes())
        if rest or length != self._image_bytes() or index >= len(self._buffers):
            raise _system_error(errno.EINVAL)
        return self._buffers[index]

    def wait_readable(self, descriptor: int, timeout_s: float) -> bool:
        """Sleep until a frame is due, or for timeout_s."""
        self._require_open(descriptor)
        deadline_ns = self._clock() + round(timeout_s * 1e9)
        while True:
            if self.state is NodeState.MISSING:
                return True
            now_ns = self._clock()
            stream = self._advanced(now_ns)
            if stream is None or stream.ready:
                return True  # poll reports an error on a node that does not stream
            if now_ns >= deadline_ns:
                return False
            next_ns = stream.next_ns()
            until_ns = deadline_ns if next_ns is None or self._free_running else min(deadline_ns, next_ns)
            self._sleep(max(_LEAST_WAIT_S, (until_ns - now_ns) * 1e-9))

    def monotonic_ns(self) -> int:
        """Return the emulated machine's clock."""
        return self._clock()

    def sleep(self, seconds: float) -> None:
        """Let time pass on it."""
        self._sleep(seconds)

    def _require_open(self, descriptor: int) -> None:
        if descriptor != _DESCRIPTOR or not self._opened:
            raise _system_error(errno.EBADF)

    def _require_plugged(self) -> None:
        self._advanced(self._clock())
        if self.state is NodeState.MISSING:
            raise _system_error(errno.ENODEV)

    def _advanced(self, now_ns: int) -> EmulatedStream | None:
        """Return the stream as it is now; unplugs where that is scripted."""
        if self._stream is not None:
            self._stream.advance(now_ns)
            if self._stream.unplugged:
                self.unplug()
        return self._stream

    def _image_bytes(self) -> int:
        return 2 * self._size[0] * self._size[1]

    def _capability(self, *_: Any) -> tuple[Any, ...]:
        node = v4l2.CAP_VIDEO_CAPTURE | v4l2.CAP_STREAMING
        whole = node | v4l2.CAP_META_CAPTURE | v4l2.CAP_DEVICE_CAPS
        return b"uvcvideo", CARD, b"usb-emulated-1", 0x060100, whole, node

    def _format(self, index: int, kind: int, *_: Any) -> tuple[Any, ...]:
        _require(index == 0 and kind == v4l2.TYPE_VIDEO_CAPTURE)
        return index, kind, 0, b"16-bit Depth", v4l2.Z16

    def _frame_size(self, index: int, pixel_format: int, *_: Any) -> tuple[Any, ...]:
        _require(index < len(USB3_MODES) and pixel_format == v4l2.Z16)
        return index, pixel_format, v4l2.DISCRETE, *list(USB3_MODES)[index]

    def _frame_interval(self, index: int, pixel_format: int, width: int, height: int, *_: Any) -> tuple[Any, ...]:
        rates = USB3_MODES.get((width, height), ())
        _require(index < len(rates) and pixel_format == v4l2.Z16)
        return index, pixel_format, width, height, v4l2.DISCRETE, 1, rates[index]

    def _set_format(self, kind: int, width: int, height: int, *_: Any) -> tuple[Any, ...]:
        """Take the size if the camera has it, else the one of nearest area."""
        _require(kind == v4l2.TYPE_VIDEO_CAPTURE)
        if self._buffers or self.state is NodeState.BUSY:
            raise _system_error(errno.EBUSY)
        self._size = min(
            USB3_MODES, key=lambda size: (size != (width, height), abs(size[0] * size[1] - width * height))
        )
        self._fps = USB3_MODES[self._size][0]
        return kind, *self._size, v4l2.Z16, v4l2.FIELD_NONE, 2 * self._size[0], self._image_bytes()

    def _set_rate(self, kind: int, _can: int, mode: int, numerator: int, denominator: int) -> tuple[Any, ...]:
        """Take the nearest rate of the size."""
        _require(kind == v4l2.TYPE_VIDEO_CAPTURE and numerator > 0)
        if self._stream is not None or self.state is NodeState.BUSY:
            raise _system_error(errno.EBUSY)
        self._fps = min(USB3_MODES[self._size], key=lambda fps: abs(fps - denominator / numerator))
        return kind, v4l2.CAP_TIMEPERFRAME, mode, 10_000_000 // self._fps, 10_000_000  # uvcvideo counts in 100 ns

    def _request_buffers(self, count: int, kind: int, memory: int) -> tuple[Any, ...]:
        _require(kind == v4l2.TYPE_VIDEO_CAPTURE and memory == v4l2.MEMORY_MMAP)
        if self._stream is not None or self.state is NodeState.BUSY:
            raise _system_error(errno.EBUSY)
        count = min(count, 32)
        self._buffers = [mmap.mmap(-1, self._image_bytes()) for _ in range(count)]
        self._given = []
        return count, kind, memory

    def _query_buffer(self, index: int, *rest: Any) -> tuple[Any, ...]:
        _require(index < len(self._buffers))
        size = self._image_bytes()
        return index, *rest[:8], index * size, size

    def _queue(self, index: int, *rest: Any) -> tuple[Any, ...]:
        _require(index < len(self._buffers) and index not in self._given)
        self._given.append(index)
        if self._stream is not None:
            self._stream.give(index)
        return index, *rest

    def _dequeue(self, _index: int, kind: int, *_: Any) -> tuple[Any, ...]:
        _require(self._stream is not None)
        frame = self._stream.take() if self._stream is not None else None
        if frame is None:
            raise _system_error(errno.EAGAIN)
        self._given.remove(frame.index)
        seconds, rest_ns = divmod(frame.stamp_ns, 1_000_000_000)
        head = (frame.index, kind, frame.bytes_used, frame.flags, v4l2.FIELD_NONE, seconds, rest_ns // 1000)
        return *head, frame.sequence, v4l2.MEMORY_MMAP, frame.index * self._image_bytes(), self._image_bytes()

    def _stream_on(self, kind: int) -> tuple[Any, ...]:
        _require(kind == v4l2.TYPE_VIDEO_CAPTURE and bool(self._buffers))
        self._stream = EmulatedStream(
            self._supply,
            self._size,
            self._buffers,
            start_ns=self._clock(),
            period_ns=0 if self._free_running else round(1e9 / self._fps),
            faults=self._faults,
        )
        for index in self._given:
            self._stream.give(index)
        return (kind,)

    def _stream_off(self, kind: int) -> tuple[Any, ...]:
        self._stream, self._given = None, []
        return (kind,)

    def _control(self, unit: int, selector: int, query: int, size: int, address: int) -> tuple[Any, ...]:
        """Read or write the caller's memory, as the kernel does."""
        if unit != _UNIT:
            raise _system_error(errno.ENOENT)
        data = (ctypes.c_char * size).from_address(address)
        if query == v4l2.UVC_SET_CUR:
            self.firmware.write(selector, data.raw)
        else:
            data.raw = self.firmware.read(selector, query, size)
        return unit, selector, query, size, address


def _require(valid: bool) -> None:
    if not valid:
        raise _system_error(errno.EINVAL)


def _system_error(code: int) -> OSError:
    return OSError(code, os.strerror(code))
