"""The look ahead against geometry: how far from the nose the wall is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.collision import LookAheadSettings, contact_at
from planning.costmap import UnknownSpace, costmap
from planning.errors import PlanningError
from planning.vehicle import Vehicle

CAR = Vehicle(margin_m=0.1)
NOSE_M, TAIL_M = 0.3405, 0.0845
ORIGIN = np.array([-3.0, 2.0, 0.7])


@pytest.fixture(scope="module")
def room():
    """4 m x 4 m at 0.05 m, free, with a wall whose near side is at x = 3 m of the grid's axes."""
    cells = np.full((80, 80), -5.0, np.float32)
    cells[:, 60] = 5.0
    return costmap(OccupancyGrid(cells, 0.05, ORIGIN), CAR, UnknownSpace.forbidden)


def way(x, y, yaw, step_m, count=60):
    """Poses of a car that drives straight on from a pose of the grid's axes, in the map frame."""
    steps = np.column_stack([step_m * np.arange(count), np.zeros(count), np.zeros(count)])
    return se2.compose(se2.compose(ORIGIN, np.array([x, y, yaw])), steps)


@pytest.mark.parametrize("gap_m", [0.055, 0.205, 0.445])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_wall_is_met_after_the_gap_without_the_margin(room, gap_m, backwards):
    x = 3.0 - gap_m - (TAIL_M if backwards else NOSE_M)
    poses = way(x, 2.0, math.pi if backwards else 0.0, -0.01 if backwards else 0.01)
    assert contact_at(room, poses) == math.ceil(gap_m / 0.01)


def test_nothing_is_met_along_the_wall_and_before_it(room):
    assert contact_at(room, way(3.0 - 0.096 - 0.005, 1.0, math.pi / 2, 0.01)) is None
    assert contact_at(room, way(1.0, 2.0, 0.0, 0.01)) is None
    assert contact_at(room, np.zeros((0, 3))) is None


def test_a_car_that_touches_a_wall_may_only_leave_it(room):
    touching = 3.0 - NOSE_M + 0.02
    assert contact_at(room, way(touching, 2.0, 0.0, -0.01)) is None
    assert contact_at(room, way(touching, 2.0, 0.0, 0.01, count=10)) == 1
    assert contact_at(room, way(touching, 2.0, 0.0, 0.0, count=3)) is None


def test_a_thin_wall_that_the_tail_touches_is_not_driven_through(room):
    touching = 3.0 - TAIL_M + 0.02
    poses = way(touching, 2.0, math.pi, -0.01)  # comes free on the other side, after 0.5 m
    assert contact_at(room, poses) == 1


def test_what_is_touched_does_not_excuse_what_comes_after(room):
    cells = np.full((80, 80), -5.0, np.float32)
    cells[:, 60] = 5.0
    cells[:, 30] = 5.0  # its near side at x = 1.55 m
    both = costmap(OccupancyGrid(cells, 0.05, ORIGIN), CAR, UnknownSpace.forbidden)
    poses = way(3.0 - NOSE_M + 0.02, 2.0, 0.0, -0.01, count=150)
    gap_m = 3.0 - NOSE_M + 0.02 - TAIL_M - 1.55
    assert contact_at(both, poses) == math.ceil(gap_m / 0.01)


def test_along_a_wall_that_is_touched_the_next_piece_is_a_contact(room):
    beside = 3.0 - 0.096 + 0.01
    assert contact_at(room, way(beside, 1.0, math.pi / 2, 0.01)) in range(1, 8)


def test_the_edge_of_the_map_is_a_wall(room):
    assert contact_at(room, way(0.4, 2.0, math.pi, 0.01)) is not None


def test_the_look_is_never_shorter_than_the_braking_way():
    settings = LookAheadSettings(horizon_s=0.1, deceleration_mps2=0.5, latency_s=0.2)
    assert settings.reach_m(-1.0) == pytest.approx(0.2 + 1.0)
    assert LookAheadSettings().reach_m(0.5) == pytest.approx(0.5)
    with pytest.raises(PlanningError, match="horizon_s is nan"):
        LookAheadSettings(horizon_s=math.nan)
