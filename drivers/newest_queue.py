"""A bounded queue between a thread that must not wait and one that may be slow."""

from __future__ import annotations

import queue
from typing import Generic, TypeVar

_T = TypeVar("_T")


class NewestQueue(Generic[_T]):
    """Holds the newest `limit` items: in a full one the oldest goes, and is counted in `dropped`. Thread-safe."""

    def __init__(self, limit: int) -> None:
        self.dropped = 0
        self._items: queue.Queue[_T] = queue.Queue(limit)

    def put(self, item: _T) -> None:
        """Add an item without waiting; one thread puts."""
        while True:
            try:
                self._items.put_nowait(item)
            except queue.Full:
                self.dropped += self.take(0.0) is not None
            else:
                return

    def take(self, timeout_s: float) -> _T | None:
        """Return the oldest item, None where there is none within the time."""
        try:
            return self._items.get(timeout=timeout_s) if timeout_s > 0 else self._items.get_nowait()
        except queue.Empty:
            return None

    def take_newest(self, timeout_s: float) -> _T | None:
        """Return the newest item and let the others go, uncounted: they were not wanted."""
        newest = self.take(timeout_s)
        while (item := self.take(0.0)) is not None:
            newest = item
        return newest
