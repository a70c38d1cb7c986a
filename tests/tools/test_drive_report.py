"""The verdict and the table on rows that are made by hand."""

from __future__ import annotations

import json

import pytest

from tools.drive_report import report_of, table_of

GOOD = {"arrived": True, "goal_m": 0.02, "goal_deg": 3.0, "cross_track_m": 0.02, "place_off_m": 0.03, "contacts": 0}
STOP = {"command_s": 0.4, "stood_s": 0.8, "in_time": True, "vehicle_timeout_s": 3.0, "noticed_s": 0.2, "contacts": 0}
BOX = {"good": True, "arrived": True, "no_way_reported": False, "contacts": 0, "place_off_m": 0.01}


def text(arrivals=(), stops=None, boxes=()):
    report = report_of(arrivals, stops or {}, boxes)
    json.dumps(report, allow_nan=False)
    return report["passed"], "\n".join(table_of(report))


def test_all_good_passes():
    passed, words = text([GOOD] * 3, {"e-stop": [STOP]}, [BOX] * 2)
    assert passed
    for part in ("3 of 3 drives", "2.0 cm", "place: 3.0 cm", "e-stop: 1 of 1", "0.40 s", "0.80 s", "2 of 2 without"):
        assert part in words


@pytest.mark.parametrize(
    ("arrivals", "stops", "boxes"),
    [
        ([GOOD, {**GOOD, "arrived": False}], {}, []),
        ([{**GOOD, "cross_track_m": 0.07}], {}, []),
        ([{**GOOD, "contacts": 1}], {}, []),
        ([], {"link cut": [{**STOP, "in_time": False}]}, []),
        ([], {}, [{**BOX, "good": False}]),
    ],
)
def test_anything_that_is_not_good_fails(arrivals, stops, boxes):
    assert not text(arrivals, stops, boxes)[0]


def test_a_contact_of_a_misplaced_car_is_told_apart():
    touched = [{**GOOD, "contacts": 2, "place_off_m": 0.11}, {**GOOD, "contacts": 1}]
    assert "contact: 2 (1 of them with a place off by 6 cm or more)" in text(touched)[1]


def test_where_nothing_of_ours_arrives_the_vehicles_timeout_is_named():
    rows = [{**STOP, "command_s": None, "noticed_s": None}, {**STOP, "stood_s": 3.5, "noticed_s": 0.45}]
    words = text(stops={"vehicle deaf": rows})[1]
    for part in ("2 of 2", "timeout of 3 s", "standing after 3.50 s", "noticed after 0.45 s"):
        assert part in words


def test_a_car_that_never_stands_is_not_given_a_time():
    words = text(stops={"killed": [{**STOP, "stood_s": None, "in_time": False}]})[1]
    assert "0 of 1" in words
    assert "endless" in words


def test_parts_that_were_left_out_are_not_in_the_table():
    assert text(stops={"e-stop": []}) == (True, "drives with contact: 0\nall of it simulated")


def test_what_is_touched_while_nothing_of_ours_arrives_is_told_with_the_stop_and_not_held_against_the_drive():
    blind = {**STOP, "command_s": None, "noticed_s": None, "contacts": 9}
    passed, words = text(stops={"killed": [blind], "e-stop": [STOP]})
    assert passed
    assert "1 touched something in that time" in words
    assert "drives with contact: 0" in words
    assert not text(stops={"e-stop": [{**STOP, "contacts": 1}]})[0]
