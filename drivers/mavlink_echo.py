"""Whether the vehicle hears us: its heartbeats do not tell, its answers to TIMESYNC do.

TIMESYNC is asked with tc1 = 0 and a stamp of ours in ts1, and answered with that stamp
(mavlink.io/en/services/timesync.html). A vehicle that has never answered does not know the message: nothing is said
about it.
"""

from __future__ import annotations

from collections import deque

from drivers.mavlink_codec import MavlinkMessage

_KEPT = 100  # questions whose answer would still be known as one


class Echo:
    """Times are ns of any clock that never steps back. every_ns: between questions."""

    def __init__(self, every_ns: int) -> None:
        self._every_ns = every_ns
        self._asked_ns: int | None = None
        self._open_ns: deque[int] = deque(maxlen=_KEPT)  # when each question was asked that is without an answer
        self._since_ns: int | None = None  # when the first of them was, also where it is kept no more
        self._answers = False

    def question(self, now_ns: int) -> dict[str, int] | None:
        """Return the fields of the TIMESYNC to be sent now, None if none is due."""
        if self._asked_ns is not None and now_ns - self._asked_ns < self._every_ns:
            return None
        self._asked_ns = now_ns
        self._open_ns.append(now_ns)
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        return {"tc1": 0, "ts1": now_ns}

    def hear(self, message: MavlinkMessage) -> None:
        """Take a TIMESYNC: an answer to one of our questions, to somebody else's, or a question of the vehicle's."""
        if message.tc1 == 0 or message.ts1 not in self._open_ns:
            return
        self._answers = True
        while self._open_ns and self._open_ns[0] <= message.ts1:
            self._open_ns.popleft()
        self._since_ns = self._open_ns[0] if self._open_ns else None

    def unanswered_s(self, now_ns: int) -> float:
        """Return for how long a question has been without an answer; 0 where the vehicle never answers any."""
        return (now_ns - self._since_ns) * 1e-9 if self._answers and self._since_ns is not None else 0.0
