"""Setpoints that expire: what was commanded last is repeated for as long as it lives, then standstill."""

from __future__ import annotations

from collections.abc import Callable

from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_settings import MavlinkSettings
from drivers.vehicle import STANDSTILL, DriveCommand

_BURST = 3


class Setpoints:
    """Sends over `link` from when it is engaged on; clock: returns ns.

    held: standstill is sent whatever is commanded.
    """

    def __init__(self, link: MavlinkLink, clock: Callable[[], int], settings: MavlinkSettings) -> None:
        self.engaged = False
        self.held = False
        self._link, self._clock, self._settings = link, clock, settings
        self._command, self._commanded_ns = STANDSTILL, 0
        self._sent_ns = 0
        self._standing_until_ns = 0

    def engage(self) -> None:
        """Take commands from now on; it begins with standstill."""
        self._command, self._commanded_ns = STANDSTILL, self._clock()
        self.engaged, self.held = True, False

    def disengage(self) -> None:
        """Take no commands any more; nothing is sent, but where stand_for says so."""
        self.engaged, self._command = False, STANDSTILL

    def drive(self, command: DriveCommand) -> None:
        """Send the command now and repeat it; nothing where it is not engaged."""
        if self.engaged:
            self._command, self._commanded_ns = command, self._clock()
            self._send(STANDSTILL if self.held else command)

    def stand_for(self, seconds: float) -> None:
        """Repeat standstill for so long, also where it is not engaged."""
        self._standing_until_ns = self._clock() + round(seconds * 1e9)

    def burst(self) -> None:
        """Standstill several times over, since packets get lost, and again from repeat() for a while."""
        self.stand_for(self._settings.standing_s)
        for _ in range(_BURST):
            self._send(STANDSTILL)

    def repeat(self) -> None:
        """Send what is due."""
        now_ns = self._clock()
        if now_ns - self._sent_ns < self._settings.repeat_s * 1e9:
            return
        if self.engaged:
            fresh = now_ns - self._commanded_ns <= self._settings.command_life_s * 1e9
            self._send(self._command if fresh and not self.held else STANDSTILL)
        elif now_ns < self._standing_until_ns:
            self._send(STANDSTILL)

    def _send(self, command: DriveCommand) -> None:
        self._sent_ns = self._clock()
        self._link.setpoint(command)
