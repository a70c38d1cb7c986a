"""One simulated drive from a start to a goal, and how it ended."""

from __future__ import annotations

import math

import numpy as np

from tools.autopilot import AutopilotState
from tools.drive_bench import Bench
from tools.drive_scores import arrival, contacts, largest_cross_track_m, place_off_m
from tools.results import Report

MOST_S = 150.0


def drive_to_goal(bench: Bench, number: int) -> Report:
    """Drive the number-th case."""
    case = bench.case(number)
    loop, pilot, car = case.loop()
    loop.run(MOST_S)
    truth = case.truth(car)
    end = arrival(truth.in_map[-1], case.goal)
    return {
        "arrived": pilot.state is AutopilotState.arrived and end.is_within(),
        "state": pilot.state.value,
        "fault": loop.drive.fault,
        "goal_m": round(end.away_m, 4),
        "goal_deg": round(math.degrees(end.turned_rad), 2),
        "cross_track_m": round(largest_cross_track_m(truth, loop.log.ticks, pilot.drives), 4),
        "place_off_m": round(place_off_m(truth, loop.log.places), 4),
        "contacts": contacts(truth, car.world.world, bench.vehicle),
        "paths": len(pilot.drives),
        "length_m": round(sum(drive.path.length_m for drive in pilot.drives[:1]), 2),
        "top_mps": round(float(np.abs(truth.speeds_mps).max()), 3),
        "seconds": round(float(truth.stamps_s[-1] - truth.stamps_s[0]), 1),
        "notes": [text for _, text in pilot.notes],
    }


def told_arrival(row: Report) -> str:
    """Return a row in words."""
    return (
        f"{row['state']}, {row['goal_m'] * 100:.1f} cm and {row['goal_deg']:.1f} deg off, at most"
        f" {row['cross_track_m'] * 100:.1f} cm beside the path, place {row['place_off_m'] * 100:.1f} cm off,"
        f" {row['paths']} paths, {row['contacts']} contacts"
    )
