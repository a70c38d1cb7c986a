"""What many simulated drives come to: sums, verdict, and the table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tools.drive_scores import ARRIVED_M, ARRIVED_RAD
from tools.drive_stops import STOP_S, TIMEOUT_S, StopCause
from tools.results import Report

CROSS_TRACK_M = 0.06
MISPLACED_M = 0.06  # a contact of a car that believes to be so far away is the localisation's


def report_of(arrivals: Sequence[Report], stops: Mapping[str, Sequence[Report]], boxes: Sequence[Report]) -> Report:
    """Return the report on rows of each part; `passed` tells whether all is as it must be.

    What a car touches that nothing of ours reaches any more, until its own timeout stops it, is told with that stop.
    """
    ours = [row for cause, rows in stops.items() for row in rows if not StopCause(cause).by_timeout]
    every = [*arrivals, *boxes, *ours]
    touched = [row for row in every if row["contacts"]]
    beside = [row["cross_track_m"] for row in arrivals]
    report: Report = {
        "simulated": True,
        "drives": len(arrivals),
        "arrived": sum(row["arrived"] for row in arrivals),
        "goal_m_max": max((row["goal_m"] for row in arrivals), default=None),
        "goal_deg_max": max((row["goal_deg"] for row in arrivals), default=None),
        "cross_track_m_p95": _percentile(beside, 95.0),
        "cross_track_m_median": _percentile(beside, 50.0),
        "place_off_m_max": max((row["place_off_m"] for row in arrivals), default=None),
        "contacts": len(touched),
        "contacts_misplaced": sum(row.get("place_off_m", 0.0) >= MISPLACED_M for row in touched),
        "stops": {
            cause: {"drives": len(rows), "in_time": sum(row["in_time"] for row in rows), "rows": list(rows)}
            for cause, rows in stops.items()
        },
        "boxes": {"drives": len(boxes), "good": sum(row["good"] for row in boxes), "rows": list(boxes)},
        "arrivals": {"drives": len(arrivals), "rows": list(arrivals)},
    }
    off_m = report["cross_track_m_p95"]
    report["passed"] = bool(
        report["arrived"] == len(arrivals)
        and (off_m is None or off_m <= CROSS_TRACK_M)
        and not touched
        and all(row["in_time"] for rows in stops.values() for row in rows)
        and all(row["good"] for row in boxes)
    )
    return report


def table_of(report: Report) -> list[str]:
    """Return the report as lines of text."""
    lines = _arrival_lines(report) if report["drives"] else []
    lines += [_stop_line(StopCause(cause), part) for cause, part in report["stops"].items() if part["drives"]]
    box = report["boxes"]
    if box["drives"]:
        around = sum(row["arrived"] for row in box["rows"])
        told = sum(row["no_way_reported"] for row in box["rows"])
        lines.append(
            f"box on the path: {box['good']} of {box['drives']} without contact ({around} drove round it, {told}"
            " reported no way)"
        )
    contacts, misplaced = report["contacts"], report["contacts_misplaced"]
    why = f" ({misplaced} of them with a place off by {MISPLACED_M * 100:.0f} cm or more)" if contacts else ""
    return [*lines, f"drives with contact: {contacts}{why}", "all of it simulated"]


def _arrival_lines(report: Report) -> list[str]:
    within = f"{ARRIVED_M:g} m and {math.degrees(ARRIVED_RAD):.0f} deg"
    farthest = f"farthest {report['goal_m_max']:.3f} m, {report['goal_deg_max']:.1f} deg"
    median_cm, most_cm = report["cross_track_m_median"] * 100, report["cross_track_m_p95"] * 100
    allowed = f"{CROSS_TRACK_M * 100:.0f} cm allowed"
    beside = f"median {median_cm:.1f} cm, 95th percentile {most_cm:.1f} cm ({allowed})"
    return [
        f"{report['arrived']} of {report['drives']} drives arrived within {within} ({farthest})",
        f"largest cross-track error of a drive: {beside}",
        f"largest error of the place: {report['place_off_m_max'] * 100:.1f} cm",
    ]


def _stop_line(cause: StopCause, part: Report) -> str:
    """Return how one cause went: when the zero-speed command left, when the car stood."""
    rows = [row for row in part["rows"] if "command_s" in row]
    counted = f"{cause.value}: {part['in_time']} of {part['drives']} stopped in time"
    if not rows:
        return counted
    stood = _most([row["stood_s"] for row in rows])
    if cause.by_timeout:
        timeout_s = max(row["vehicle_timeout_s"] for row in rows)
        rule = f"by the vehicle's own timeout of {timeout_s:g} s (+ {TIMEOUT_S:g} s and braking allowed)"
        noticed = [row["noticed_s"] for row in rows if row["noticed_s"] is not None]
        seen = f", noticed after {max(noticed):.2f} s at most" if noticed else ""
        blind = sum(row["contacts"] > 0 for row in rows)
        touched = f", {blind} touched something in that time" if blind else ""
        return f"{counted} {rule}, standing after {stood} at most{seen}{touched}"
    command = _most([row["command_s"] for row in rows])
    return f"{counted}, zero speed after {command} at most ({STOP_S:g} s allowed), standing after {stood} at most"


def _most(seconds: Sequence[float | None]) -> str:
    known = [value for value in seconds if value is not None]
    return f"{max(known):.2f} s" if len(known) == len(seconds) else "an endless time"


def _percentile(values: Sequence[float], share: float) -> float | None:
    return round(float(np.percentile(values, share)), 4) if values else None
