"""The look ahead against geometry: how far from the nose the wall is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.vehicle import DriveCommand
from mapping import se2
from mapping.grid import OccupancyGrid
from planning.collision import LookAheadSettings, look_ahead
from planning.costmap import UnknownSpace, costmap
from planning.errors import PlanningError
from planning.vehicle import Vehicle

CAR = Vehicle(margin_m=0.1)
NOSE_M, TAIL_M, SIDE_M = 0.3405, 0.0845, 0.096
ORIGIN = np.array([-3.0, 2.0, 0.7])


@pytest.fixture(scope="module")
def room():
    """4 m x 4 m at 0.05 m, free, with a wall whose near side is at x = 3 m of the grid's axes."""
    cells = np.full((80, 80), -5.0, np.float32)
    cells[:, 60] = 5.0
    return costmap(OccupancyGrid(cells, 0.05, ORIGIN), CAR, UnknownSpace.forbidden)


def at(x, y, yaw):
    return se2.compose(ORIGIN, np.array([x, y, yaw]))


@pytest.mark.parametrize("gap_m", [0.05, 0.2, 0.44])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_wall_ahead_is_met_after_the_gap_without_the_margin(room, gap_m, backwards):
    x = 3.0 - gap_m - (TAIL_M if backwards else NOSE_M)
    pose = at(x, 2.0, math.pi if backwards else 0.0)
    found = look_ahead(room, pose, DriveCommand(-0.5 if backwards else 0.5, 0.0))
    assert gap_m <= found.contact_m + 1e-9
    assert found.contact_m <= gap_m + 0.011
    assert found.contact_s == pytest.approx(found.contact_m / 0.5)
    assert not found.is_free


def test_beyond_the_horizon_nothing_is_in_the_way(room):
    pose = at(3.0 - NOSE_M - 0.6, 2.0, 0.0)
    assert look_ahead(room, pose, DriveCommand(0.5, 0.0)).is_free
    assert not look_ahead(room, pose, DriveCommand(0.5, 0.0), LookAheadSettings(horizon_s=2.0)).is_free


def test_a_curve_leads_away_from_the_wall_and_another_into_it(room):
    pose = at(3.0 - SIDE_M - 0.02, 1.0, math.pi / 2)  # along the wall, which is to the right
    assert look_ahead(room, pose, DriveCommand(0.4, 0.0)).is_free
    assert not look_ahead(room, pose, DriveCommand(0.4, -1.5)).is_free


def test_a_car_that_touches_a_wall_may_only_leave_it(room):
    pose = at(3.0 - NOSE_M + 0.02, 2.0, 0.0)
    assert look_ahead(room, pose, DriveCommand(-0.2, 0.0)).is_free
    assert look_ahead(room, pose, DriveCommand(0.2, 0.0)).contact_m == 0.0


def test_the_edge_of_the_map_is_a_wall(room):
    assert not look_ahead(room, at(0.2, 2.0, math.pi), DriveCommand(0.4, 0.0)).is_free


def test_a_standing_car_hits_nothing(room):
    assert look_ahead(room, at(2.9, 2.0, 0.0), DriveCommand(0.0, 1.0)).is_free


def test_the_look_is_never_shorter_than_the_braking_way():
    settings = LookAheadSettings(horizon_s=0.1, deceleration_mps2=0.5, latency_s=0.2)
    assert settings.reach_m(-1.0) == pytest.approx(0.2 + 1.0)
    with pytest.raises(PlanningError, match="horizon_s is nan"):
        LookAheadSettings(horizon_s=math.nan)
