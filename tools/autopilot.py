"""From scans to drive commands: place, map of today, plan, follower, look ahead, safety stage.

No clock and no link: whoever has them tells scans and times and sends what comes out, on a car or in the simulator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import STANDSTILL, DriveCommand
from mapping.grid import OccupancyGrid
from mapping.relocalisation import Located
from mapping.slam import MappedScan
from planning.follower import FollowerStatus, FollowerStep
from planning.motion_prediction import MotionPrediction
from planning.path import Path
from planning.safety import SafeCommand, SafetyStage, Stamps
from planning.vehicle import Vehicle
from tools.drive_planning import DrivePlanning, NextPath
from tools.drive_settings import AutopilotSettings
from tools.drive_status import ENDS, NOWHERE, AutopilotState, Situation, words_of
from tools.map_of_today import Ground, Place, SavedGround, Sight
from tools.path_following import Following
from tools.path_search import PathSearch

__all__ = ["Autopilot", "AutopilotSettings", "AutopilotState", "Drive"]

FloatArray = NDArray[np.float64]
NO_OFFSET = np.zeros(2)
_STUCK_S = 1.0
_USUAL = AutopilotSettings()


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One path on the way to the goal, from when on it was followed, and why it was planned."""

    begun_s: float
    path: Path
    reason: str


class Autopilot:
    """Drives to goals (3,) one after another, on a saved map or on other ground.

    Of a saved map: sensor (2,), the laser's place on the body, and guess (3,), where about the car stands; None: the
    car looks for its place itself. One thread may add scans while another ticks: a tick waits neither for matching nor
    for planning. All that drives belongs to the tick; scans come over as one object that does not change. `drives` and
    `notes` tell what happened, with times in s; goal_number counts from 0.
    """

    def __init__(
        self,
        ground: OccupancyGrid | Ground,
        vehicle: Vehicle,
        goals: Sequence[FloatArray],
        search: PathSearch,
        sensor: FloatArray = NO_OFFSET,
        settings: AutopilotSettings = _USUAL,
        guess: FloatArray | None = None,
    ) -> None:
        if len(goals) == 0:
            raise ValueError("no goal to drive to: give at least one")
        self.safety = SafetyStage(settings.safety)
        self.state = AutopilotState.locating
        self.drives: list[Drive] = []
        self.notes: list[tuple[float, str]] = []
        self.step: FollowerStep | None = None
        self.goal_number = 0
        if isinstance(ground, OccupancyGrid):
            ground = SavedGround(ground, vehicle, sensor, settings, guess)
        self._ground, self._settings = ground, settings
        self._goals = [np.array(goal, dtype=np.float64) for goal in goals]
        self._planning = DrivePlanning(search, vehicle, settings, self.notes)
        self._prediction = MotionPrediction(settings.motion)
        self._sight = Sight(None, "no scan yet")
        self._scan_s: float | None = None
        self._following: Following | None = None
        self._left: Following | None = None  # braked on
        self._ticked_s: float | None = None
        self._safe = SafeCommand(STANDSTILL, "no command yet", stopped=True)

    @property
    def place(self) -> Located | None:
        """Where the car was at the last scan that told."""
        place = self._sight.place
        return None if place is None else place.located

    def note_scan(self, stamp_s: float) -> None:
        """Take note of a scan that came, whether or not it gives a pose."""
        self._scan_s = stamp_s

    def add_scan(self, mapped: MappedScan) -> None:
        """Take in a scan that was matched."""
        sight = self._ground.add(mapped)
        if sight is not None:
            self._sight = sight

    def tick(self, now_s: float) -> SafeCommand:
        """Return what to send to the vehicle now; call it 20 times a second."""
        sight = self._sight
        place = sight.place
        self._notice(sight, now_s)
        wanted = STANDSTILL if place is None else self._wanted(place, now_s)
        stamps = Stamps(None if place is None else place.stamp_s, self._scan_s, now_s)
        self._safe = safe = self.safety.step(wanted, stamps, now_s)
        self._ticked_s = now_s
        self._prediction.tell(now_s, safe.command)
        return safe

    def status(self, now_s: float) -> str:
        """Return in one line what the car is doing, why, and how far it has to go; any thread may ask."""
        if self._ticked_s is not None and now_s - self._ticked_s > _STUCK_S:
            return f"no command was made for {now_s - self._ticked_s:.1f} s: the drive loop is stuck"
        sight, step = self._sight, self.step
        return words_of(
            Situation(
                self.state,
                self.goal_number,
                len(self._goals),
                remaining_m=0.0 if step is None else step.remaining_m,
                place=sight.reason,
                planning=self._planning.given_up or self._planning.words,
                by_odometry=sight.place is not None and sight.place.located.by_odometry,
                safe=self._safe,
                emergency=self.safety.emergency,
            )
        )

    def _notice(self, sight: Sight, now_s: float) -> None:
        """Find out whether the place was found or lost."""
        if sight.place is None:
            if self.state not in (*NOWHERE, *ENDS):
                self.state = AutopilotState.lost
                self._following = self._left = None
                self.notes.append((now_s, f"lost: {sight.reason}"))
        elif self.state in NOWHERE and not sight.place.located.by_odometry:
            was_lost = self.state is AutopilotState.lost
            self.state = AutopilotState.planning
            self._planning.begin(self._goals[self.goal_number], "found again" if was_lost else "set out")

    def _wanted(self, place: Place, now_s: float) -> DriveCommand:
        soon_s = now_s + self._settings.motion.latency_s
        pose = self._prediction.pose_at(place.located.T_map_base, place.stamp_s, soon_s)
        speed_mps = self._prediction.speed_mps(soon_s)
        if self.state is AutopilotState.planning:
            found = self._planning.step(place, pose, speed_mps, now_s)
            if found is not None:
                self._set_out(found, now_s)
            elif self._planning.given_up:
                self.state = AutopilotState.no_way
        if self._following is not None:
            return self._follow(self._following, place, pose, speed_mps, now_s)
        if self._left is not None and self.state is AutopilotState.planning:
            return self._left.braking(pose, speed_mps, now_s)
        return STANDSTILL

    def _set_out(self, found: NextPath, now_s: float) -> None:
        self._following, self._left = Following(found.path, self._settings), None
        self.drives.append(Drive(now_s, found.path, found.reason))
        self.state = AutopilotState.backing_off if found.backs_off else AutopilotState.driving

    def _follow(
        self, following: Following, place: Place, pose: FloatArray, speed_mps: float, now_s: float
    ) -> DriveCommand:
        self.step = step = following.step(place.near, pose, speed_mps, now_s)
        if following.blocked:
            self.notes.append((now_s, following.blocked))
            self._leave(following)
            self._planning.again(following.blocked, following.driven)
        elif step.status is FollowerStatus.arrived:
            self._arrive(following)
        return step.command

    def _leave(self, following: Following) -> None:
        self._following, self._left = None, following
        self.state = AutopilotState.planning

    def _arrive(self, following: Following) -> None:
        """Go on from the end of a path."""
        backed_off = self.state is AutopilotState.backing_off
        self._leave(following)
        if backed_off:
            self._planning.again("backed off")
        elif self.goal_number + 1 < len(self._goals):
            self.goal_number += 1
            self._planning.begin(self._goals[self.goal_number], f"goal {self.goal_number} reached")
        else:
            self.state = AutopilotState.arrived
