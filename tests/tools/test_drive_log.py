from __future__ import annotations

import json

import numpy as np

from drivers.vehicle import STANDSTILL, DriveCommand
from mapping.relocalisation import Located
from planning.safety import SafeCommand
from tools.drive_log import DriveLog

DRIVES = SafeCommand(DriveCommand(0.4, 0.0))
GOALS = [np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 3.1])]


class Pilot:
    goal_number = 0
    place = None


def at(x, y, yaw):
    return Located(0, np.array([x, y, yaw]), np.zeros(3), np.eye(3), 1.0, "")


def stopped(reason):
    return SafeCommand(STANDSTILL, reason, stopped=True)


def test_goals_are_noted_once_with_how_far_off_the_car_believes_it_is():
    pilot = Pilot()
    log = DriveLog(pilot, GOALS, 100.0)
    log.note(101.0, DRIVES, at_end=False)
    pilot.goal_number, pilot.place = 1, at(1.0, 0.03, 0.0)
    for _ in range(2):
        log.note(104.5, DRIVES, at_end=False)
    pilot.place = at(2.04, 0.03, -3.1)
    for _ in range(2):
        log.note(110.0, DRIVES, at_end=True)
    report = log.report([(102.0, "something on the path")])
    assert [(each["goal"], each["at_s"], each["off_m"]) for each in report["arrivals"]] == [
        (1, 4.5, 0.03),
        (2, 10.0, 0.05),
    ]
    assert report["arrivals"][1]["off_deg"] < 5.0, "3.1 and -3.1 rad are neighbours"
    assert report["notes"] == [{"at_s": 2.0, "text": "something on the path"}]
    assert report["top_mps"] == 0.4
    assert json.loads(json.dumps(report)) == report


def test_a_stop_is_noted_with_its_first_reason_and_how_long_it_lasted():
    log = DriveLog(Pilot(), GOALS, 0.0)
    log.note(0.0, stopped("no pose yet"), at_end=False)  # it has not driven yet
    log.note(1.0, DRIVES, at_end=False)
    log.note(2.0, stopped("the last scan is 0.51 s old"), at_end=False)
    log.note(2.5, stopped("the last scan is 1.01 s old"), at_end=False)
    log.note(3.5, DRIVES, at_end=False)
    log.note(9.0, stopped("emergency stop"), at_end=False)
    assert log.report([])["stops"] == [
        {"at_s": 2.0, "reason": "the last scan is 0.51 s old", "seconds": 1.5},
        {"at_s": 9.0, "reason": "emergency stop", "seconds": None},
    ]
    assert log.arrived == 0
