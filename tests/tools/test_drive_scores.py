"""The scorer against drives whose errors are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.rover_dynamics import RoverModel
from drivers.vehicle import DriveCommand
from planning.path import path_along
from planning.safety import SafeCommand
from planning.vehicle import Vehicle
from tools.autopilot import AutopilotState, Drive
from tools.closed_loop import Tick
from tools.drive_scores import TrueDrive, arrival, contacts, largest_cross_track_m, place_off_m, stop_after
from tools.world import World

CAR = RoverModel(acceleration_mps2=1.5, latency_s=0.1)


def straight(offset_m=0.0, seconds=4.0, speed_mps=0.5):
    """A drive along y = offset, a pose every 10 ms, in a map that is the world."""
    stamps = np.arange(0.0, seconds, 0.01)
    poses = np.column_stack([1.0 + speed_mps * stamps, np.full(len(stamps), offset_m), np.zeros(len(stamps))])
    return TrueDrive(stamps, poses, poses, np.full(len(stamps), speed_mps))


def tick(now_s, speed_mps=0.5, progress_m=None, following=True):
    safe = SafeCommand(DriveCommand(speed_mps, 0.0))
    progress_m = 0.5 * now_s if progress_m is None else progress_m
    return Tick(now_s, safe, 0, progress_m, following, AutopilotState.driving)


LINE = path_along(np.column_stack([np.arange(1.0, 4.0, 0.01), np.zeros(300), np.zeros(300)]))


@pytest.mark.parametrize("offset_m", [0.0, 0.037, -0.2])
def test_the_cross_track_error_is_the_distance_to_the_line(offset_m):
    ticks = [tick(t) for t in np.arange(0.0, 4.0, 0.05)]
    found = largest_cross_track_m(straight(offset_m), ticks, [Drive(0.0, LINE, "")])
    assert found == pytest.approx(abs(offset_m), abs=1e-9)


def test_time_without_a_path_does_not_count():
    ticks = [tick(t, following=False) for t in np.arange(0.0, 4.0, 0.05)]
    assert largest_cross_track_m(straight(0.3), ticks, [Drive(0.0, LINE, "")]) == 0.0


def test_another_part_of_the_path_nearby_does_not_hide_an_error():
    there = np.column_stack([np.arange(1.0, 4.0, 0.01), np.zeros(300), np.zeros(300)])
    back = np.column_stack([np.arange(4.0, 1.0, -0.01), np.full(300, 0.2), np.full(300, math.pi)])
    path = path_along(np.vstack([there, back]))
    ticks = [tick(t) for t in np.arange(0.0, 4.0, 0.05)]
    assert largest_cross_track_m(straight(0.2), ticks, [Drive(0.0, path, "")]) == pytest.approx(0.2, abs=1e-9)


def test_arrival_is_measured_at_the_last_true_pose():
    end = arrival(straight(0.03).in_map[-1], np.array([1.0 + 0.5 * 3.99 + 0.04, 0.0, -0.2]))
    assert end.away_m == pytest.approx(0.05)
    assert end.turned_rad == pytest.approx(0.2)
    assert end.is_within()
    assert not end.is_within(0.04)
    assert not arrival(np.zeros(3), np.array([0.0, 0.0, 0.3])).is_within()


def test_a_wall_that_the_body_reaches_is_a_contact():
    occupied = np.zeros((200, 300), np.bool_)
    occupied[112:115, 150] = True  # at x = 3 m, y = 0.24 m
    world = World(occupied, 0.02, np.array([0.0, -2.0, 0.0]))
    assert contacts(straight(0.0), world, Vehicle()) == 0
    assert contacts(straight(0.16), world, Vehicle()) > 0
    assert contacts(straight(0.16, seconds=2.0), world, Vehicle()) == 0  # it never gets there


def sent(until_s=4.0):
    """Setpoints of half a metre a second that end, or turn to standstill, at a time."""
    return [(t, 0.5 if t < until_s else 0.0) for t in np.arange(0.0, 4.0, 0.05).tolist()]


def test_a_stop_counts_from_the_event_to_the_last_motion():
    truth = straight()
    truth.speeds_mps[:210] = 0.2
    truth.speeds_mps[250:] = 0.0
    stop = stop_after(truth, sent(2.18), 2.0)
    assert stop.command_s == pytest.approx(0.2)
    assert stop.stood_s == pytest.approx(0.5)
    assert stop.speed_mps == 0.5  # it brakes from that, however slow it was at the event
    assert stop.in_time(0.6, CAR)
    assert not stop.in_time(0.1, CAR)
    assert not stop.in_time(0.6, RoverModel(acceleration_mps2=10.0, latency_s=0.1))


def test_a_car_that_never_stops_is_not_in_time():
    stop = stop_after(straight(), sent(), 2.0)
    assert (stop.command_s, stop.stood_s) == (math.inf, math.inf)
    assert not stop.in_time(0.6, CAR)
    assert not stop.by_timeout(3.0, CAR)


def test_where_nothing_is_sent_any_more_the_vehicles_timeout_counts():
    truth = straight()
    truth.speeds_mps[350:] = 0.0
    stop = stop_after(truth, [item for item in sent() if item[0] < 2.0], 2.0)
    assert (stop.command_s, stop.event_mps) == (math.inf, 0.5)
    assert stop.by_timeout(1.1, CAR)
    assert not stop.by_timeout(1.0, CAR)


def test_the_place_is_off_by_its_distance_from_the_truth_at_its_stamp():
    truth = straight(0.0)
    places = [(t, np.array([1.0 + 0.5 * t + 0.03, off, 0.0])) for t, off in ((1.005, 0.0), (2.0, 0.04))]
    assert place_off_m(truth, places) == pytest.approx(0.05)
    assert place_off_m(truth, []) == 0.0
