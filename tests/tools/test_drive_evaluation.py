"""The evaluation's verdict and table on reports that are made by hand; whole drives are in test_closed_loop."""

from __future__ import annotations

import numpy as np

from mapping import se2
from mapping.grid import OccupancyGrid
from tools.drive_evaluation import Bench, Mapped, table_of


def mapped():
    """A free hall of 12 m x 6 m at 0.05 m, driven along its middle."""
    cells = np.full((120, 240), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, -1]] = 5.0
    driven = np.column_stack([np.arange(1.0, 11.0, 0.1), np.full(100, 3.0), np.zeros(100)])
    return Mapped(OccupancyGrid(cells, 0.05, np.zeros(3)), driven, np.array([1.0, 2.0, 0.3]))


def test_cases_are_repeatable_apart_and_near_where_the_map_was_made():
    bench = Bench(mapped(), 5, lambda _: None)
    cases = [bench.case(number) for number in (0, 1, 0)]
    np.testing.assert_array_equal(cases[0].start, cases[2].start)
    assert not np.allclose(cases[0].start, cases[1].start)
    for case in cases:
        assert 2.0 < np.hypot(*(case.goal - case.start)[:2]) < 8.0
        assert abs(case.start[1] - 3.0) <= 0.8
        assert 0.0 < np.hypot(*se2.between(case.start, case.told)[:2]) < 0.3


def test_the_table_says_how_many_of_how_many():
    stop = {"drives": 2, "in_time": 1, "rows": [{"command_s": 0.4}, {"command_s": 0.7}]}
    box = {"drives": 3, "good": 2, "rows": [{"arrived": True, "no_way_reported": False}] * 3}
    report = {
        "drives": 4, "arrived": 3, "goal_m_max": 0.2, "goal_deg_max": 7.0, "cross_track_m_median": 0.02,
        "cross_track_m_p95": 0.051, "contacts": 1, "stops": {"e-stop": stop}, "boxes": box,
    }  # fmt: skip
    text = "\n".join(table_of(report))
    for words in ("3 of 4 drives", "5.1 cm", "e-stop: 1 of 2", "0.70 s", "2 of 3 without contact", "contact: 1"):
        assert words in text


def test_parts_that_were_left_out_are_not_in_the_table():
    empty = {"drives": 0, "in_time": 0, "good": 0, "rows": []}
    report = {"drives": 0, "contacts": 0, "stops": {"e-stop": empty}, "boxes": empty}
    assert table_of(report) == ["drives with contact: 0"]
