"""A whole drive through the link, in the office; its map is made from the world itself."""

from __future__ import annotations

from tools.drive_arrivals import drive_to_goal, told_arrival


def test_a_drive_arrives_and_is_scored(exact_bench):
    row = drive_to_goal(exact_bench, 1000)
    assert row["arrived"]
    assert row["fault"] == ""
    assert row["contacts"] == 0
    assert 0.0 < row["cross_track_m"] < 0.06
    assert 0.0 < row["place_off_m"] < 0.06
    assert 0.4 < row["top_mps"] <= 0.5 + 1e-9
    assert told_arrival(row).startswith("arrived, ")
