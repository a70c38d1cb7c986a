"""Whether the vehicle hears us: its heartbeats do not tell, its answers to TIMESYNC do.

TIMESYNC is asked with tc1 = 0 and a stamp of ours in ts1, and answered with that stamp
(mavlink.io/en/services/timesync.html). A vehicle that has never answered does not know the message: nothing is said
about it.
"""

from __future__ import annotations

from collections import deque

from drivers.mavlink_codec import MavlinkMessage

_MOST_OPEN = 100


class Echo:
    """Times are ns of any clock that never steps back. every_ns: between questions."""

    def __init__(self, every_ns: int) -> None:
        self._every_ns = every_ns
        self._asked_ns: int | None = None
        self._open_ns: deque[int] = deque()  # when each question was asked that is still without an answer
        self._answers = False

    def question(self, now_ns: int) -> dict[str, int] | None:
        """Return the fields of the TIMESYNC to be sent now, None if none is due."""
        if self._asked_ns is not None and now_ns - self._asked_ns < self._every_ns:
            return None
        self._asked_ns = now_ns
        if len(self._open_ns) < _MOST_OPEN:
            self._open_ns.append(now_ns)
        return {"tc1": 0, "ts1": now_ns}

    def hear(self, message: MavlinkMessage) -> None:
        """Take a TIMESYNC: an answer to one of our questions, or a question of the vehicle's, which is none."""
        if message.tc1 == 0 or self._asked_ns is None or message.ts1 > self._asked_ns:
            return
        self._answers = True
        while self._open_ns and self._open_ns[0] <= message.ts1:
            self._open_ns.popleft()

    def unanswered_s(self, now_ns: int) -> float:
        """Return for how long a question has been without an answer; 0 where the vehicle never answers any."""
        return (now_ns - self._open_ns[0]) * 1e-9 if self._answers and self._open_ns else 0.0
