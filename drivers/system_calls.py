"""The system calls that the camera driver makes, as a protocol: the real ones here, an emulated camera's elsewhere.

A driver that gets its system calls handed in runs unmodified on either.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import select
import struct
import sys
import time
from typing import Protocol

from drivers.errors import DriverError

if sys.platform == "linux":
    import fcntl

_POINTER_BYTES = struct.calcsize("P")


class SystemCalls(Protocol):
    """What a device node is reached by. Failures are OSErrors with their errno."""

    def open(self, path: str) -> int:
        """Open for reading and writing without blocking; return the descriptor."""
        ...

    def close(self, descriptor: int) -> None:
        """Release the descriptor."""
        ...

    def ioctl(self, descriptor: int, request: int, argument: bytearray) -> None:
        """Make the request; what the device answers replaces the content of argument."""
        ...

    def mmap(self, descriptor: int, length: int, offset: int) -> mmap.mmap:
        """Map a buffer of the device into memory, shared, for reading and writing."""
        ...

    def wait_readable(self, descriptor: int, timeout_s: float) -> bool:
        """Wait until there is something to take, or the device is in error; False on time-out."""
        ...

    def monotonic_ns(self) -> int:
        """Return CLOCK_MONOTONIC, the clock of the buffers' stamps."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        ...


class LinuxSystemCalls:
    """The real ones. Raises DriverError on systems without V4L2 in the layout that this driver knows."""

    def __init__(self) -> None:
        if sys.platform != "linux" or _POINTER_BYTES != 8 or sys.byteorder != "little":
            raise DriverError(
                f"cameras need 64-bit Linux, this is {sys.platform} with {_POINTER_BYTES * 8}-bit words:"
                " use a recording, or a 64-bit system"
            )

    def open(self, path: str) -> int:
        """See SystemCalls."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        """See SystemCalls."""
        os.close(descriptor)

    def ioctl(self, descriptor: int, request: int, argument: bytearray) -> None:
        """See SystemCalls; begun anew where a signal interrupts it."""
        done = False
        while not done:
            with contextlib.suppress(InterruptedError):
                fcntl.ioctl(descriptor, request, argument)
                done = True

    def mmap(self, descriptor: int, length: int, offset: int) -> mmap.mmap:
        """See SystemCalls."""
        return mmap.mmap(descriptor, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset)

    def wait_readable(self, descriptor: int, timeout_s: float) -> bool:
        """See SystemCalls."""
        poller = select.poll()
        poller.register(descriptor, select.POLLIN)
        return bool(poller.poll(timeout_s * 1000))

    def monotonic_ns(self) -> int:
        """See SystemCalls."""
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """See SystemCalls."""
        time.sleep(seconds)
