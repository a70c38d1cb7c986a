"""The image stream of an emulated camera: buffers that are filled when a frame is due, and scripted faults.

No thread: whoever asks says what time it is, and all frames that were due by then have happened.
"""

from __future__ import annotations

import mmap
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from drivers.v4l2 import BUFFER_ERROR, TIMESTAMP_MONOTONIC

_SEQUENCES = 1 << 32
Image = NDArray[np.uint16]
Images = Iterable[Image] | Callable[[int], Image]


@dataclass(frozen=True, slots=True)
class StreamFaults:
    """What goes wrong, by frame number from 0 in each stream.

    unplug_at: the camera vanishes instead of this frame. silent_from: no frame from this one on. flagged: frames with
    the kernel's error mark. short: frames of which only half arrives. gaps: frame -> numbers skipped before it.
    """

    unplug_at: int | None = None
    silent_from: int | None = None
    flagged: frozenset[int] = frozenset()
    short: frozenset[int] = frozenset()
    gaps: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class EmulatedFrame:
    """What the kernel says of a filled buffer."""

    index: int
    bytes_used: int
    flags: int
    stamp_ns: int
    sequence: int


class FrameSupply:
    """Frames by their number, from an iterable (in order, one a frame) or a function of the stamp in ns."""

    def __init__(self, images: Images) -> None:
        self._at = images if callable(images) else None
        self._next: Iterator[Image] = iter(()) if callable(images) else iter(images)

    def take(self, stamp_ns: int, *, wanted: bool) -> tuple[Image | None, bool]:
        """Return the frame's image, None if not wanted, and whether there is a frame at all: an iterable may end."""
        if self._at is not None:
            return (self._at(stamp_ns) if wanted else None), True
        image = next(self._next, None)
        return image, image is not None


class EmulatedStream:
    """Streams frames of `size` into buffers; period_ns 0 runs free, as fast as buffers are given and asked for."""

    def __init__(
        self,
        supply: FrameSupply,
        size: tuple[int, int],
        buffers: list[mmap.mmap],
        *,
        start_ns: int,
        period_ns: int,
        faults: StreamFaults,
    ) -> None:
        self._supply = supply
        self._shape = (size[1], size[0])
        self._buffers = buffers
        self._period_ns = period_ns
        self._due_ns = start_ns + period_ns
        self._faults = faults
        self._frame = 0
        self._sequence = 0
        self._waiting: deque[int] = deque()
        self._filled: deque[EmulatedFrame] = deque()
        self._ended = False
        self.unplugged = False
        self.overruns = 0  # frames for which no buffer waited

    def give(self, index: int) -> None:
        """Take a buffer to fill."""
        self._waiting.append(index)

    def take(self) -> EmulatedFrame | None:
        """Return the oldest filled buffer."""
        return self._filled.popleft() if self._filled else None

    @property
    def ready(self) -> bool:
        """Whether a wait would end now."""
        return bool(self._filled) or self.unplugged

    def next_ns(self) -> int | None:
        """When the next frame is due; None if none will come."""
        return None if self._ended or self.unplugged else self._due_ns

    def advance(self, now_ns: int) -> None:
        """Let everything happen that was due by now."""
        if self._period_ns == 0:
            if self._waiting and not self._filled and not self._ended and not self.unplugged:
                self._expose(now_ns)
            return
        while not self._ended and not self.unplugged and self._due_ns <= now_ns:
            self._expose(self._due_ns)
            self._due_ns += self._period_ns

    def _expose(self, stamp_ns: int) -> None:
        number, faults = self._frame, self._faults
        if number == faults.unplug_at:
            self.unplugged = True
            return
        image, exists = self._supply.take(stamp_ns, wanted=bool(self._waiting))
        if not exists or (faults.silent_from is not None and number >= faults.silent_from):
            self._ended = True
            return
        self._frame += 1
        sequence = (self._sequence + faults.gaps.get(number, 0)) % _SEQUENCES
        self._sequence = (sequence + 1) % _SEQUENCES
        if not self._waiting or image is None:
            self.overruns += 1
            return
        index = self._waiting.popleft()
        used = self._fill(self._buffers[index], image)
        if number in faults.short:
            used //= 2
        flags = TIMESTAMP_MONOTONIC | (BUFFER_ERROR if number in faults.flagged else 0)
        self._filled.append(EmulatedFrame(index, used, flags, stamp_ns, sequence))

    def _fill(self, buffer: mmap.mmap, image: Image) -> int:
        if image.shape != self._shape or image.dtype != np.uint16:
            raise ValueError(f"image of {image.shape} {image.dtype}, expected {self._shape} uint16 as the chosen mode")
        np.frombuffer(buffer, "<u2").reshape(self._shape)[:] = image
        return int(image.nbytes)
