"""Rows of an experiment that was interrupted are not computed again, and no half of one is believed."""

from __future__ import annotations

import pytest

from tools.finished_rows import FinishedRows, finish_rows


def squared(number):
    return {"square": number * number}


def test_rows_are_found_again_by_key_and_settings(tmp_path):
    path = tmp_path / "new/rows.jsonl"
    FinishedRows(path, "100 runs").add("a", {"x": 1})
    FinishedRows(path, "10 runs").add("a", {"x": 2})
    again = FinishedRows(path, "100 runs")
    assert (again.get("a"), again.get("b")) == ({"x": 1}, None)
    assert FinishedRows(path, "10 runs").get("a") == {"x": 2}
    assert FinishedRows(path, "1 run").get("a") is None


def test_a_line_that_was_cut_off_is_left_out_and_does_not_spoil_the_next(tmp_path):
    path = tmp_path / "rows.jsonl"
    FinishedRows(path, "s").add("a", {"x": 1})
    whole = path.read_text()
    path.write_text(whole + whole.replace('"a"', '"b"').strip()[:-5])
    rows = FinishedRows(path, "s")
    assert rows.get("b") is None
    rows.add("c", {"x": 3})
    again = FinishedRows(path, "s")
    assert (again.get("a"), again.get("b"), again.get("c")) == ({"x": 1}, None, {"x": 3})


def test_only_rows_that_are_missing_are_worked_on(tmp_path):
    rows = FinishedRows(tmp_path / "rows.jsonl", "s")
    rows.add("2", {"square": -1})
    worked: list[int] = []

    def counted(number):
        worked.append(number)
        return squared(number)

    found = finish_rows(rows, counted, {"3": (3,), "2": (2,), "1": (1,)}, 1, "squares")
    assert worked == [3, 1]
    assert list(found.items()) == [("3", {"square": 9}), ("2", {"square": -1}), ("1", {"square": 1})]


def test_what_was_finished_before_a_failure_is_kept(tmp_path):
    path = tmp_path / "rows.jsonl"

    def fails_at_two(number):
        if number == 2:
            raise RuntimeError("cut off")
        return squared(number)

    with pytest.raises(RuntimeError, match="cut off"):
        finish_rows(FinishedRows(path, "s"), fails_at_two, {"1": (1,), "2": (2,), "3": (3,)}, 1, "squares")
    again = FinishedRows(path, "s")
    assert (again.get("1"), again.get("2"), again.get("3")) == ({"square": 1}, None, None)
