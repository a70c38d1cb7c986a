"""Shortening: never dearer, always free, and the ends stay where they are."""

from __future__ import annotations

import numpy as np
import pytest

from planning.costmap import Costmap, UnknownSpace, costmap
from planning.edges import steering
from planning.improving import Improvement
from planning.pieces import Pieces, words_between
from planning.vehicle import Vehicle
from tools.plan_checks import colliding_poses

DETOUR = np.array([[1.0, 1, 0], [1.5, 3, 1.5], [2.4, 4, 0], [3.3, 3, -0.6], [5, 3, 0], [6.5, 1.5, -1.5]])


@pytest.fixture(scope="module", params=[False, True])
def known(request, rooms) -> Costmap:
    return costmap(rooms, Vehicle(turning_radius_m=0.45, forward_only=request.param), UnknownSpace.forbidden)


@pytest.fixture
def detour(known) -> Pieces:
    pieces = words_between(DETOUR, *steering(known.vehicle))
    assert known.all_fit(known.world(pieces.sampled(0.45)[0]))
    return pieces


def test_it_never_costs_more_stays_free_and_keeps_its_ends(known, detour, rooms):
    path = Improvement(known, detour)
    costs = [path.cost_m]
    for seed in range(40):
        path.attempt(20, seed)
        costs.append(path.cost_m)
        poses, gears = path.pieces.sampled(0.45)
        assert known.all_fit(known.world(poses))
        assert colliding_poses(rooms, rooms.occupied, known.world(poses), known.vehicle.body) == 0
        np.testing.assert_allclose(poses[[0, -1], :2], DETOUR[[0, -1], :2], atol=1e-6)
        if known.vehicle.forward_only:
            assert (gears == 1).all()
    assert (np.diff(costs) <= 1e-9).all()
    assert costs[-1] < 0.9 * costs[0]
    assert path.cost_m >= np.hypot(*(DETOUR[-1] - DETOUR[0])[:2])
    vehicle = known.vehicle
    assert path.cost_m == pytest.approx(path.pieces.cost_m(vehicle.reverse_cost, vehicle.cusp_cost_m))


def test_pieces_join_without_a_gap(known, detour):
    path = Improvement(known, detour)
    path.attempt(400, 7)
    poses, _ = path.pieces.sampled(0.45)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.01 + 1e-6


def test_same_seed_same_bits(known, detour):
    one, other = Improvement(known, detour), Improvement(known, detour)
    for path in (one, other):
        path.attempt(200, 3)
    np.testing.assert_array_equal(one.pieces.starts, other.pieces.starts)
    np.testing.assert_array_equal(one.pieces.lengths, other.pieces.lengths)
