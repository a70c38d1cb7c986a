"""Stops on the way through the real link, in the office whose map is made from the world itself: some seconds each."""

from __future__ import annotations

from tools.drive_stops import STOP_S, StopCause, stop_on_the_way, told_stop


def test_a_killed_process_sends_nothing_and_the_vehicle_stops_itself(exact_bench):
    row = stop_on_the_way(exact_bench, 1000, StopCause.killed)
    assert row["in_time"]
    assert row["command_s"] is None
    assert row["vehicle_timeout_s"] == 3.0
    assert row["vehicle_timeout_s"] - 0.1 < row["stood_s"] < row["vehicle_timeout_s"] + 0.6
    assert "no zero speed sent" in told_stop(row)


def test_a_deaf_vehicle_is_noticed_long_before_it_stops(exact_bench):
    row = stop_on_the_way(exact_bench, 1000, StopCause.deaf)
    assert row["in_time"]
    assert row["noticed_s"] <= STOP_S
    assert "does not hear us" in row["fault"]
