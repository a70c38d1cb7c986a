"""How a drive stands, told in the log once a second."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from drivers.vehicle import VehicleState

log = logging.getLogger(__name__)
_EVERY_S, _UNCHANGED_S = 1.0, 10.0


class StatusLine:
    """Says once a second how things stand, and every ten what has not changed; say: takes a line."""

    def __init__(self, say: Callable[[str], None] = log.info) -> None:
        self._say = say
        self._next_s = self._said_s = -math.inf
        self._said = ""
        self._state: VehicleState | None = None

    def tell(self, now_s: float, words: Callable[[], str]) -> None:
        """Say it, if it is time."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _EVERY_S
        line = words()
        if line != self._said or now_s - self._said_s >= _UNCHANGED_S:
            self._said, self._said_s = line, now_s
            self._say(line)

    def vehicle(self, state: VehicleState) -> None:
        """Say what has changed about the vehicle."""
        last, self._state = self._state, state
        if last is None or (last.armed, last.mode) != (state.armed, state.mode):
            self._say(f"vehicle: {'armed' if state.armed else 'disarmed'}, mode {state.mode}")
