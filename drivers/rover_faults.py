"""What can go wrong with an emulated rover, and when: KIND[=VALUE][@START[+DURATION]].

START is in seconds after the rover was switched on; without it the fault holds from the beginning, without DURATION to
the end: `silence@5+2`, `mode=MANUAL@8`, `refuse-arm`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from drivers.mavlink_constants import RoverMode


class RoverFaultKind(str, Enum):
    """What goes wrong; FAULTS says it in words."""

    SILENCE = "silence"
    DEAF = "deaf"
    CUT = "cut"
    REFUSE_ARM = "refuse-arm"
    MODE = "mode"
    DISARM = "disarm"


FAULTS = {
    RoverFaultKind.SILENCE: "silence: the rover sends nothing, but hears and obeys",
    RoverFaultKind.DEAF: "deaf: the rover hears nothing, but sends",
    RoverFaultKind.CUT: "cut: the link is cut both ways",
    RoverFaultKind.REFUSE_ARM: "refuse-arm: the rover says why and stays disarmed",
    RoverFaultKind.MODE: "mode=NAME@START: somebody puts the rover into another mode, such as MANUAL",
    RoverFaultKind.DISARM: "disarm@START: the rover disarms itself",
}
_AT_AN_INSTANT = (RoverFaultKind.MODE, RoverFaultKind.DISARM)


class RoverFaultError(ValueError):
    """A fault that cannot be read; the text is one line for the user."""


@dataclass(frozen=True, slots=True)
class RoverFault:
    """One fault; mode: what MODE names."""

    kind: RoverFaultKind
    start_s: float = 0.0
    duration_s: float = math.inf
    mode: RoverMode | None = None

    def holds(self, seconds: float) -> bool:
        """Whether it is on so many seconds after switching on."""
        return self.start_s <= seconds < self.start_s + self.duration_s


def any_holds(faults: Iterable[RoverFault], seconds: float, *kinds: RoverFaultKind) -> bool:
    """Whether a fault of one of the kinds is on."""
    return any(fault.kind in kinds and fault.holds(seconds) for fault in faults)


def parse_rover_fault(text: str) -> RoverFault:
    """Read one fault as the module describes it; raises RoverFaultError."""
    what, at, when = text.strip().partition("@")
    name, _, value = what.partition("=")
    if name not in {kind.value for kind in RoverFaultKind}:
        known = ", ".join(kind.value for kind in RoverFaultKind)
        raise RoverFaultError(f"fault {text!r}: unknown, choose one of {known}")
    kind = RoverFaultKind(name)
    if (kind == RoverFaultKind.MODE) != bool(value) or (value and value not in RoverMode.__members__):
        raise RoverFaultError(f"fault {text!r}: expected {FAULTS[kind]}; modes: {', '.join(RoverMode.__members__)}")
    if kind in _AT_AN_INSTANT and not at:
        raise RoverFaultError(f"fault {text!r}: expected {FAULTS[kind]}")
    start, plus, duration = when.partition("+")
    try:
        start_s = float(start) if at else 0.0
        duration_s = float(duration) if plus else math.inf
    except ValueError:
        start_s = math.nan
    if not (math.isfinite(start_s) and start_s >= 0 and duration_s > 0):
        raise RoverFaultError(f"fault {text!r}: after @ expected START[+DURATION] in seconds, such as @5 or @5+2")
    return RoverFault(kind, start_s, duration_s, RoverMode[value] if value else None)
