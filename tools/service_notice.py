"""What a service manager is told: that mapping has begun, that it goes on, how it stands, that it ends (sd_notify(3)).

The messages of sd_notify are lines of text in datagrams to a socket that the environment names. A message that cannot
be sent is no reason to stop mapping.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from typing_extensions import override

from drivers.messages import Recordable
from mapping.slam import MappedScan
from tools.session_parts import LiveSession, SessionPart

_TIMES_A_WATCHDOG = 4.0  # a message may be lost, and a busy computer late
_STATUS_S = 2.0


class ServiceNotice(SessionPart):
    """The notices of one run.

    The service has started with the first scan that is mapped, and is alive while scans are mapped: a sensor that is
    silent, a thread that is stuck and a mapping that is too slow all end in silence. address: a path, or an abstract
    name that begins with @. watchdog_s: the service manager ends us when it hears nothing for so long; None: it does
    not. status: says how a drive stands. clock: seconds, monotonic.
    """

    tells = False
    needs_map = False
    hurries = False

    def __init__(
        self,
        address: str,
        watchdog_s: float | None = None,
        *,
        status: Callable[[], str] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._address, self._status = address, status
        self._period_s = None if watchdog_s is None else watchdog_s / _TIMES_A_WATCHDOG
        self._clock = clock
        self._scans = 0
        self._alive_s = self._told_s = float("-inf")

    @override
    def begin(self, session: LiveSession) -> None:
        """The sensors are started; the service is not, until a scan is mapped."""
        self._send("STATUS=waiting for the first scan")

    def note(self, message: Recordable) -> None:
        """What comes from a sensor tells nothing of mapping."""

    def add(self, mapped: MappedScan) -> None:
        """Tell what is due."""
        now = self._clock()
        lines = []
        if self._scans == 0:
            lines.append("READY=1")
        self._scans += 1
        if self._period_s is not None and now - self._alive_s >= self._period_s:
            self._alive_s = now
            lines.append("WATCHDOG=1")
        if now - self._told_s >= _STATUS_S:
            self._told_s = now
            lines.append(f"STATUS={' '.join(self._line(mapped).split())}")
        if lines:
            self._send(*lines)

    def end(self) -> None:
        """The run ends: what follows is saved, and takes its time."""
        self._send("STOPPING=1", "STATUS=saving and refining the map")

    @override
    def save(self, folder: Path) -> dict[str, Any]:
        """Nothing is kept."""
        return {}

    def _line(self, mapped: MappedScan) -> str:
        x, y, _ = mapped.pose
        drive = "" if self._status is None else f"; {self._status()}"
        return f"mapping: {self._scans} scans, the car is at x {x:.2f} m, y {y:.2f} m{drive}"

    def _send(self, *lines: str) -> None:
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), address)


def service_notices(
    environment: Mapping[str, str], status: Callable[[], str] | None = None
) -> tuple[ServiceNotice, ...]:
    """Return the notices that systemd asks of this process, or none: NOTIFY_SOCKET, WATCHDOG_USEC, WATCHDOG_PID.

    status: see ServiceNotice.
    """
    address = environment.get("NOTIFY_SOCKET")
    if not address:
        return ()
    microseconds = environment.get("WATCHDOG_USEC", "")
    is_ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    watchdog_s = int(microseconds) * 1e-6 if is_ours and microseconds.isdecimal() else 0.0
    return (ServiceNotice(address, watchdog_s or None, status=status),)
