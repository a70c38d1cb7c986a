"""Where turns begin in standard nodes: one damaged byte can raise the flag or lower it, so the angles have a say.

Nodes are held back while their angles pass zero. One flag in there begins the turn; none or several leave it to where
the angle itself passed zero, and the turns on both sides are not called whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from drivers.rplidar_capsules import FULL_TURN_Q6, Flags, IntArray, Packets, Samples, decode_nodes

_FROM_Q6, _TO_Q6 = -20 * 64, 12 * 64  # the sensor raises its flag at up to 8 deg before zero and one step after
_FAR_Q6 = 90 * 64  # from here on the next passage may come
_MOST_HELD = 2000  # nodes: a head that stands still at zero begins no turn


@dataclass(frozen=True, slots=True, eq=False)
class SettledNodes:
    """Samples whose turn flags can be believed; doubtful: the one that the first of them raises is a guess."""

    samples: Samples
    doubtful: bool


class NodeTurns:
    """Settles the turn flags of one stream's nodes."""

    def __init__(self) -> None:
        self._held = np.empty((0, 5), dtype=np.uint8)
        self._may_pass = True  # has the head been far from zero since the last turn began?
        self._last_q6: int | None = None  # angle before the nodes held
        self._after_gap = False

    def take(self, packets: Packets) -> list[SettledNodes]:
        """Add consecutive nodes (P, 5); return what is settled, in order."""
        settled: list[SettledNodes] = []
        if self._after_gap:
            packets, settled = self._cross_gap(packets)
        if len(self._held):
            packets = np.concatenate((self._held, packets))
        return settled + self._settle(packets, at_end=False)

    def gap(self) -> list[SettledNodes]:
        """Nodes were lost here; return all that were held."""
        settled = self._settle(self._held, at_end=True)
        self._after_gap = self._last_q6 is not None
        return settled

    def _cross_gap(self, packets: Packets) -> tuple[Packets, list[SettledNodes]]:
        """Tell whether the head passed zero in the gap: then the first node behind it begins a turn."""
        self._after_gap = False
        first = decode_nodes(packets[:1])
        angle_q6 = _signed(int(first.angle_q6[0]))
        last_q6 = _signed(self._last_q6 or 0)
        if self._may_pass and 0 <= angle_q6 < _FAR_Q6:
            self._may_pass = False
            self._last_q6 = int(first.angle_q6[0])
            first.new_turn[0] = True
            return packets[1:], [SettledNodes(first, doubtful=True)]
        if _TO_Q6 <= last_q6 < _FAR_Q6 and angle_q6 < 0:
            self._may_pass = True
        return packets, []

    def _settle(self, packets: Packets, *, at_end: bool) -> list[SettledNodes]:
        samples = decode_nodes(packets)
        settled: list[SettledNodes] = []
        begun = start = 0
        doubtful = False
        while start < len(samples):
            stop, turn, flags = _next_passage(samples.angle_q6, samples.new_turn, start, self._may_pass, at_end)
            self._may_pass = bool(flags & 1)
            if turn >= 0:
                settled += _part(samples, begun, turn, doubtful)
                begun, doubtful = turn, bool(flags & 2)
            if stop == start:
                break
            start = stop
        settled += _part(samples, begun, start, doubtful)
        self._held = packets[start:].copy()
        if start:
            self._last_q6 = int(samples.angle_q6[start - 1])
        return settled


def _part(samples: Samples, start: int, stop: int, doubtful: bool) -> list[SettledNodes]:
    if stop <= start:
        return []
    return [SettledNodes(samples.part(start, stop), doubtful)]


@njit(cache=True, nogil=True)
def _signed(angle_q6: int) -> int:
    return angle_q6 if angle_q6 < FULL_TURN_Q6 // 2 else angle_q6 - FULL_TURN_Q6


@njit(cache=True, nogil=True)
def _next_passage(
    angle_q6: IntArray, new_turn: Flags, start: int, may_pass: bool, at_end: bool
) -> tuple[int, int, int]:
    """Settle the flags from start up to and with the next passage of zero.

    Returns where it stopped, the node that begins a turn or -1, and bits: 1 the next passage may come, 2 the turn is a
    guess. It stops before a passage that is not over, unless at_end.
    """
    count, at = len(angle_q6), start
    while at < count:
        angle = _signed(angle_q6[at])
        if may_pass and _FROM_Q6 < angle < _TO_Q6:
            break
        new_turn[at] = False
        may_pass = may_pass or angle <= _FROM_Q6 or angle >= _FAR_Q6
        at += 1
    begin, flagged, flags, crossing = at, -1, 0, -1
    while at < count:
        angle = _signed(angle_q6[at])
        if angle >= _TO_Q6 or at - begin >= _MOST_HELD:
            break
        if angle < 0:
            crossing = at + 1
        at += 1
    if at == begin or (at == count and not at_end):
        return begin, -1, int(may_pass)
    if crossing < 0:
        crossing = begin
    for node in range(begin, at):
        if new_turn[node]:
            flags += 1
            if flagged < 0 or abs(node - crossing) < abs(flagged - crossing):
                flagged = node
            new_turn[node] = False
    turn = flagged if flags else crossing
    if turn >= at or at - begin >= _MOST_HELD:  # cut off before zero
        return at, -1, int(may_pass)
    new_turn[turn] = True
    return at, turn, 0 if flags == 1 and not at_end else 2
