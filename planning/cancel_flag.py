"""A number in memory that two processes share: the last request that was cancelled."""

from __future__ import annotations

import os
import tempfile
from mmap import mmap

from drivers.sources import Closing

_BYTES = 8


class CancelFlag(Closing):
    """Written by the process that asks, read by the one that works; reading takes no system call.

    Requests are numbered from 1; one that is cancelled stays so, and later ones are not. descriptor: that of another
    process's flag, inherited from it; None makes a new one, with all requests wanted.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        if descriptor is None:
            with tempfile.TemporaryFile() as file:
                file.truncate(_BYTES)
                descriptor = os.dup(file.fileno())
        self.descriptor = descriptor
        self._memory = mmap(descriptor, _BYTES)
        self._number = memoryview(self._memory).cast("Q")

    def cancel(self, number: int) -> None:
        """Cancel a request, and those before it."""
        self._number[0] = number

    def is_cancelled(self, number: int) -> bool:
        """Whether a request is no longer wanted."""
        return bool(self._number[0] >= number)

    def close(self) -> None:
        """Release the memory; closing twice is allowed."""
        if not self._memory.closed:
            self._number.release()
            self._memory.close()
            os.close(self.descriptor)
