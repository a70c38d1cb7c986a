"""What mapping reads from: a source of stamped messages, and the byte link below the lidar's decoder.

Live, replay and emulator differ below these two protocols only, so the decoder that runs on the robot runs in every
test.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import TracebackType
from typing import Protocol

from typing_extensions import Self

from drivers.messages import Message


class Closing(ABC):
    """Something open, as a context manager: leaving it closes it."""

    @abstractmethod
    def close(self) -> object:
        """Release what is held; closing twice is allowed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class ByteLink(Protocol):
    """A two-way byte stream to a device: a serial port, recorded bytes or a fake.

    Errors are DriverErrors; `read` raises DeviceLostError when the far end is gone.
    """

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived; wait up to timeout_s for the first byte; b"" on time-out."""
        ...

    def write(self, data: bytes) -> None:
        """Send all of data."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the speed and drop what was received at the old one."""
        ...

    def set_dtr(self, asserted: bool) -> None:
        """Set the DTR line (motor of A1-style boards); links without the line ignore it."""
        ...

    def set_rts(self, asserted: bool) -> None:
        """Set the RTS line, likewise."""
        ...

    def close(self) -> None:
        """Release the link; closing twice is allowed."""
        ...


class MessageSource(Protocol):
    """A context manager that one iterates for messages, in the order in which they were received."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def __iter__(self) -> Iterator[Message]: ...
