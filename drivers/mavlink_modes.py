"""The modes of the two usual autopilots: in which they take our setpoints, in which they stand, what they are called.

ArduPilot numbers a vehicle's modes; PX4 packs a main and a sub mode into one number (px4_custom_mode.h).
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mavlink_constants import Autopilot, RoverMode

_PX4_NAMES = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
_PX4_AUTO_NAMES = {1: "READY", 2: "TAKEOFF", 3: "HOLD", 4: "MISSION", 5: "RTL", 6: "LAND"}


@dataclass(frozen=True, slots=True)
class Modes:
    """guided: takes our setpoints; hold: stands. Each as the second and third parameter of DO_SET_MODE."""

    guided: tuple[int, int]
    hold: tuple[int, int]
    guided_name: str


ARDUROVER = Modes((RoverMode.GUIDED, 0), (RoverMode.HOLD, 0), "GUIDED")
PX4 = Modes((6, 0), (4, 3), "OFFBOARD")


def modes_of(autopilot: int) -> Modes:
    """Return the modes of an autopilot; one of another kind is taken for PX4, whose numbers most imitate."""
    return ARDUROVER if autopilot == Autopilot.ARDUPILOT else PX4


def mode_name(autopilot: int, custom_mode: int) -> str:
    """Return what a heartbeat's custom mode is called, such as GUIDED or OFFBOARD."""
    if autopilot == Autopilot.ARDUPILOT:
        known = custom_mode in RoverMode.__members__.values()
        return RoverMode(custom_mode).name if known else f"mode {custom_mode}"
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == 4 and sub in _PX4_AUTO_NAMES:
        return _PX4_AUTO_NAMES[sub]
    return _PX4_NAMES.get(main, f"mode {custom_mode}")
