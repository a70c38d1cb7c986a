"""What is driven, and in which order rows come back; whole drives are in test_closed_loop and test_drive_stops."""

from __future__ import annotations

from tools.drive_evaluation import DrivesWanted
from tools.drive_stops import StopCause


def test_each_cause_has_its_stops_and_no_case_comes_twice():
    tasks = DrivesWanted(drives=3, stops=2, boxes=1).tasks
    assert len(tasks) == len(set(tasks)) == 3 + 2 * len(StopCause) + 1
    for cause in StopCause:
        assert sum(part == cause.value for part, _ in tasks) == 2


def test_parts_may_be_left_out():
    assert DrivesWanted(drives=0, stops=0, boxes=0).tasks == []
