"""What the autopilot is doing, in words for whoever watches."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from planning.safety import SafeCommand


class AutopilotState(str, Enum):
    """What it is doing. lost: it was somewhere, and looks for its place again; no_way: there is none to the goal."""

    locating = "locating"
    planning = "planning"
    driving = "driving"
    backing_off = "backing_off"
    arrived = "arrived"
    no_way = "no_way"
    lost = "lost"


ENDS = (AutopilotState.arrived, AutopilotState.no_way)
NOWHERE = (AutopilotState.locating, AutopilotState.lost)


@dataclass(frozen=True, slots=True)
class Situation:
    """What there is to tell. remaining_m: to the end of the path; place: what it rests on, or why there is none.

    planning: what is done about a path, or why there is none; by_odometry: the last scans did not fit the map.
    """

    state: AutopilotState
    goal_number: int
    goals: int
    remaining_m: float
    place: str
    planning: str
    by_odometry: bool
    safe: SafeCommand
    emergency: str


def words_of(now: Situation) -> str:
    """Return one line."""
    goal = f"goal {now.goal_number + 1}" + (f" of {now.goals}" if now.goals > 1 else "")
    ends = {
        AutopilotState.locating: f"standing, looking for its place on the map: {now.place}",
        AutopilotState.lost: f"standing, its place on the map is lost, looking for it: {now.place}",
        AutopilotState.arrived: f"arrived at {goal}",
        AutopilotState.no_way: f"no way to {goal}: {now.planning}",
    }
    if now.emergency:
        return f"emergency stop: {now.emergency}"
    if now.state in ends:
        return ends[now.state]
    if now.safe.stopped:
        return f"standing on the way to {goal}: {now.safe.reason}"
    if now.state is AutopilotState.planning:
        return f"{goal}: {now.planning}"
    moves = f"{now.remaining_m:.1f} m to go, {abs(now.safe.command.speed_mps):.2f} m/s"
    moves += " backwards" if now.safe.command.speed_mps < 0.0 else ""
    moves += f"; place by odometry only: {now.place}" if now.by_odometry else ""
    if now.state is AutopilotState.backing_off:
        return f"backing off, to plan again to {goal}: {moves}"
    return f"driving to {goal}: {moves}"
