"""Scans of a live lidar for a program's own loop: the newest one, or all of them, read by a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from drivers.messages import LaserScan, LidarStream, Message, RawChunk
from drivers.newest_queue import NewestQueue
from drivers.rplidar_decoder import RplidarDecoder, load_compiled
from drivers.sources import Closing

_POLL_S = 0.05
_SPEED_TURNS = 10


class LiveLidar(Iterable[Message], Protocol):
    """What is read: an Rplidar or a ReconnectingLidar."""

    def request_stop(self) -> None:
        """End the iteration soon."""
        ...


class ScanReader(Closing):
    """Reads and decodes a lidar in a thread until closed; the lidar itself stays its owner's to close.

    A consumer that is too slow loses the oldest scans, never the newest, and `dropped` counts them.
    """

    def __init__(self, lidar: LiveLidar, *, queue_scans: int = 20) -> None:
        load_compiled()
        self._lidar = lidar
        self._scans: NewestQueue[LaserScan] = NewestQueue(queue_scans)
        self._stamps_ns: list[int] = []
        self._fault: Exception | None = None
        self._thread = threading.Thread(target=self._read, name="lidar reader", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """How many scans nobody took in time."""
        return self._scans.dropped

    @property
    def speed_hz(self) -> float | None:
        """Measured turns a second over the last whole turns; None before there are two."""
        return turn_rate_hz(self._stamps_ns)

    def latest(self, timeout_s: float = 1.0) -> LaserScan | None:
        """Return the newest scan that was not returned yet, waiting for one; None if none comes in time.

        Raises what ended the lidar, a DriverError, once its last scan was taken.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            ended = not self._thread.is_alive()  # asked first: what it left is still taken
            scan = self._scans.take_newest(min(_POLL_S, max(0.0, deadline - time.monotonic())))
            if scan is None and ended:
                self._raise_fault()
            if scan is not None or ended or time.monotonic() >= deadline:
                return scan

    def __iter__(self) -> Iterator[LaserScan]:
        """Yield every scan in order until close(); raises what ended the lidar."""
        while True:
            ended = not self._thread.is_alive()
            scan = self._scans.take(_POLL_S)
            if scan is not None:
                yield scan
            elif ended:
                self._raise_fault()
                return

    def close(self) -> None:
        """End the reading; closing twice is allowed."""
        self._lidar.request_stop()
        self._thread.join()

    def _raise_fault(self) -> None:
        if self._fault is not None:
            raise self._fault

    def _read(self) -> None:
        decoder: RplidarDecoder | None = None
        try:
            for message in self._lidar:
                if isinstance(message, LidarStream):
                    decoder = RplidarDecoder(message)
                elif isinstance(message, RawChunk) and decoder is not None:
                    for scan in decoder.feed(message):
                        self._note(scan)
        except Exception as error:  # noqa: BLE001 - raised again in the consumer's thread
            self._fault = error

    def _note(self, scan: LaserScan) -> None:
        self._stamps_ns = [*self._stamps_ns[-_SPEED_TURNS:], scan.stamp_ns] if scan.complete else []
        self._scans.put(scan)


def turn_rate_hz(stamps_ns: list[int]) -> float | None:
    """Turns a second from the first samples' times of consecutive turns; None for fewer than two."""
    if len(stamps_ns) < 2:
        return None
    return 1e9 / float(np.median(np.diff(stamps_ns)))
