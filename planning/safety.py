"""The last stage before the vehicle: whatever the follower wants, the car gets no more than this lets through.

A pure function of the times it is given, apart from the emergency stop, which holds until it is released on purpose,
and the last command, from which acceleration is counted. It can only slow down: it never makes up a motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from drivers.vehicle import DriveCommand
from planning.errors import PlanningError


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """What may leave for the vehicle at most, and how old what it rests on may be.

    speed_mps forwards and reverse_mps backwards; curvature_1pm: of a full lock (30 deg at a wheelbase of 0.256 m);
    acceleration_mps2: of speeding up; slowing down is never held back. pose_age_s, scan_age_s, command_age_s: of the
    last pose on the map, scan and follower's command, by their stamps; older, and the car is told to stand.

    Raises PlanningError for values that are not finite and positive.
    """

    speed_mps: float = 0.5
    reverse_mps: float = 0.5
    curvature_1pm: float = math.tan(math.radians(30.0)) / 0.256
    acceleration_mps2: float = 1.0
    pose_age_s: float = 0.5
    scan_age_s: float = 0.5
    command_age_s: float = 0.3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise PlanningError(f"safety: {field.name} is {value}, expected a finite number above 0")


@dataclass(frozen=True, slots=True)
class Stamps:
    """When the last pose and scan were taken and the follower's command was made, in s on one clock; None: never."""

    pose_s: float | None
    scan_s: float | None
    command_s: float | None


@dataclass(frozen=True, slots=True)
class SafeCommand:
    """What may go to the vehicle. reason: why it is not what was wanted, empty where it is; stopped: it must stand."""

    command: DriveCommand
    reason: str = ""
    stopped: bool = False


class SafetyStage:
    """Begins standing. emergency_stop() holds until release(), hold() until its reason is gone."""

    def __init__(self, limits: SafetyLimits = SafetyLimits()) -> None:
        self._limits = limits
        self._emergency = ""
        self._held = ""
        self._last_s: float | None = None
        self._last_mps = 0.0
        self._curvature = 0.0

    @property
    def emergency(self) -> str:
        """Why the car stands until it is released; empty where it does not."""
        return self._emergency

    def emergency_stop(self, reason: str) -> None:
        """Let nothing but standstill through until `release`; the first reason is kept."""
        self._emergency = self._emergency or reason or "no reason given"

    def release(self) -> None:
        """End the emergency stop."""
        self._emergency = ""

    def hold(self, reason: str) -> None:
        """Let nothing but standstill through while there is a reason, such as a vehicle that is not ready; "": none."""
        self._held = reason

    def step(self, wanted: DriveCommand, stamps: Stamps, now_s: float) -> SafeCommand:
        """Return what may go to the vehicle now."""
        objection = self._objection(stamps, now_s)
        if objection:
            self._last_s, self._last_mps = now_s, 0.0
            return SafeCommand(DriveCommand(0.0, self._curvature), objection, stopped=True)
        rule, reasons = self._limits, []
        speed = min(max(wanted.speed_mps, -rule.reverse_mps), rule.speed_mps)
        if speed != wanted.speed_mps:
            reasons.append(f"speed {wanted.speed_mps:.2f} m/s limited to {speed:.2f} m/s")
        curvature = min(max(wanted.curvature_1pm, -rule.curvature_1pm), rule.curvature_1pm)
        if curvature != wanted.curvature_1pm:
            reasons.append(f"curvature {wanted.curvature_1pm:.2f}/m limited to {curvature:.2f}/m")
        gentle = self._speeding_up(speed, now_s)
        if gentle != speed:
            reasons.append(f"acceleration limited to {rule.acceleration_mps2:g} m/s^2")
        self._last_s, self._last_mps, self._curvature = now_s, gentle, curvature
        return SafeCommand(DriveCommand(gentle, curvature), "; ".join(reasons))

    def _objection(self, stamps: Stamps, now_s: float) -> str:
        """Return why the car must stand, empty where it may drive."""
        if self._emergency:
            return f"emergency stop: {self._emergency}"
        if self._held:
            return self._held
        rule = self._limits
        for name, stamp_s, most_s in (
            ("pose", stamps.pose_s, rule.pose_age_s),
            ("scan", stamps.scan_s, rule.scan_age_s),
            ("command", stamps.command_s, rule.command_age_s),
        ):
            if stamp_s is None:
                return f"no {name} yet"
            if not -most_s <= now_s - stamp_s <= most_s:  # also of a stamp that is not a number, or of the future
                return f"the last {name} is {now_s - stamp_s:.2f} s old, {most_s:g} s are allowed"
        return ""

    def _speeding_up(self, speed_mps: float, now_s: float) -> float:
        """Return the speed, no farther from standing than may be reached since the last command."""
        last = self._last_mps
        since_s = 0.0 if self._last_s is None else max(now_s - self._last_s, 0.0)
        if last * speed_mps < 0.0:  # the other way: through standstill
            last = 0.0
        most = abs(last) + self._limits.acceleration_mps2 * since_s
        return math.copysign(min(abs(speed_mps), most), speed_mps)
