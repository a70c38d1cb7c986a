"""Where turns begin in standard nodes: one damaged byte can raise the flag or lower it, so the angles have a say.

It is decided once the head is past zero. One flag on the way begins the turn; none or several leave it to where the
angle itself passed zero, and the turns on both sides are not called whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from drivers.rplidar_capsules import FULL_TURN_Q6, Packets, as_packets

_FROM_Q6, _TO_Q6 = -20 * 64, 12 * 64  # the sensor raises its flag at up to 8 deg before zero and one step after
_FAR_Q6 = 90 * 64  # from here on the next passage may come
_MOST_HELD = 2000  # nodes: a head that stands still begins no turn
_MAY_PASS, _GUESSED = 1, 2
_SIZE = 5  # bytes


@dataclass(frozen=True, slots=True, eq=False)
class NodePiece:
    """Consecutive nodes (P, 5) of one turn; whether it ends with them, and whether that is a guess."""

    packets: Packets
    ends_turn: bool = False
    guessed: bool = False


class NodeTurns:
    """Cuts one stream's nodes into turns."""

    def __init__(self) -> None:
        self._held = b""  # nodes of the turn under way
        self._settled = 0  # so many of them are known to begin no turn
        self._may_pass = True  # has the head been far from zero since the last turn began?
        self._before_gap_q6: int | None = None

    @property
    def held(self) -> Packets:
        """Nodes (P, 5) of the turn under way."""
        return as_packets(self._held, _SIZE)

    def take(self, nodes: bytes) -> list[NodePiece]:
        """Add consecutive nodes; return what is settled, in order."""
        pieces: list[NodePiece] = []
        if self._before_gap_q6 is not None:
            pieces = self._cross_gap(self._before_gap_q6, signed_angle_q6(nodes, 0))
            self._before_gap_q6 = None
        self._held += nodes
        pieces += self._cut(at_end=False)
        if len(self._held) > _MOST_HELD * _SIZE:
            pieces += self._release()
        return pieces

    def gap(self) -> list[NodePiece]:
        """Nodes were lost here; return all that were held."""
        if not self._held:
            return []
        self._before_gap_q6 = signed_angle_q6(self._held, len(self._held) // _SIZE - 1)
        return self._cut(at_end=True) + self._release()

    def _release(self) -> list[NodePiece]:
        pieces = [NodePiece(self.held)] if self._held else []
        self._held, self._settled = b"", 0
        return pieces

    def _cross_gap(self, before_q6: int, after_q6: int) -> list[NodePiece]:
        """End the turn if the head passed zero in the gap: not where it is just behind it on both sides."""
        if self._may_pass and 0 <= after_q6 < _FAR_Q6 and not 0 <= before_q6 <= after_q6:
            self._may_pass = False
            return [NodePiece(self.held, ends_turn=True, guessed=True)]
        self._may_pass |= _TO_Q6 <= before_q6 < _FAR_Q6 and after_q6 < 0
        return []

    def _cut(self, *, at_end: bool) -> list[NodePiece]:
        pieces: list[NodePiece] = []
        while self._settled * _SIZE < len(self._held):
            stop, turn, bits = _next_passage(self._held, self._settled, self._may_pass, at_end)
            self._may_pass = bool(bits & _MAY_PASS)
            if turn < 0:
                self._settled = stop
                break
            ended = as_packets(self._held[: turn * _SIZE], _SIZE)
            pieces.append(NodePiece(ended, ends_turn=True, guessed=bool(bits & _GUESSED)))
            self._held, self._settled = self._held[turn * _SIZE :], stop - turn
        return pieces


@njit(cache=True, nogil=True)
def signed_angle_q6(nodes: bytes, place: int) -> int:
    """Angle of one of the nodes, in [-180, 180) deg."""
    angle_q6: int = np.int64(nodes[place * _SIZE + 1]) >> 1 | np.int64(nodes[place * _SIZE + 2]) << 7
    return angle_q6 if angle_q6 < FULL_TURN_Q6 // 2 else angle_q6 - FULL_TURN_Q6


@njit(cache=True, nogil=True)
def _next_passage(nodes: bytes, start: int, may_pass: bool, at_end: bool) -> tuple[int, int, int]:
    """Find where the head passes zero next, from node `start` on, which is near zero or may be anywhere.

    Returns up to where all is settled, the node that begins a turn or -1, and bits: _MAY_PASS for what comes after,
    _GUESSED. A passage that is not over is left for later, unless at_end.
    """
    count, at = len(nodes) // _SIZE, start
    while at < count:
        angle = signed_angle_q6(nodes, at)
        if may_pass and _FROM_Q6 < angle < _TO_Q6:
            break
        may_pass = may_pass or angle <= _FROM_Q6 or angle >= _FAR_Q6
        at += 1
    begin, crossing = at, at
    while at < count:
        angle = signed_angle_q6(nodes, at)
        if angle >= _TO_Q6:
            break
        at += 1
        if angle < 0:
            crossing = at
    if begin == count or (at == count and not at_end):
        return begin, -1, _MAY_PASS if may_pass else 0
    flags, turn = 0, crossing
    for node in range(begin, at):
        if nodes[node * _SIZE] & 1:
            turn = node if flags == 0 or abs(node - crossing) < abs(turn - crossing) else turn
            flags += 1
    if turn >= count:  # cut off before zero
        return count, -1, _MAY_PASS
    return at, turn, 0 if flags == 1 and not at_end else _GUESSED
