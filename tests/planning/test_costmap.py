"""Where a car may be, against a car tried there."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from planning.vehicle import Vehicle

QCAR = Vehicle()


def test_local_and_world_are_inverse_and_cells_are_where_they_are_drawn(rooms):
    costs = costmap(rooms, QCAR, UnknownSpace.forbidden)
    poses = np.array([[0.3, 0.4, 0.5], [-2.0, 3.0, -1.0]])
    np.testing.assert_allclose(costs.world(costs.local(poses)), poses, atol=1e-12)
    assert costs.size_m == pytest.approx((8.0, 6.0))
    assert costs.cell(costs.world(np.array([1.01, 0.26, 0.0]))) == (5, 20)
    assert costs.cell(costs.world(np.array([-0.01, 0.26, 0.0]))) is None


@pytest.mark.parametrize("unknown", list(UnknownSpace))
def test_where_the_car_fits_its_axle_has_a_region(rooms, unknown):
    costs = costmap(rooms, QCAR, unknown)
    random = np.random.default_rng(2)
    local = np.column_stack([random.uniform(0, 8, 4000), random.uniform(0, 6, 4000), random.uniform(-4, 4, 4000)])
    poses = costs.world(local)
    fitting = np.array([costs.fits(pose) for pose in poses])
    assert 500 < fitting.sum() < 3500
    cells = (local[:, [1, 0]] / 0.05).astype(int)
    assert (costs.region[cells[fitting, 0], cells[fitting, 1]] > 0).all()
    assert costs.all_fit(poses[fitting])
    assert not costs.all_fit(poses[:100])
    np.testing.assert_array_equal(np.isinf(costs.route_cost), costs.region == 0)


def test_unknown_space_by_policy(rooms):
    corner, speck = np.array([7.2, 5.2, 0.0]), np.array([1.4, 1.02, 0.0])
    by = {unknown: costmap(rooms, QCAR, unknown) for unknown in UnknownSpace}
    fits = {unknown: costs.fits(costs.world(corner)) for unknown, costs in by.items()}
    assert fits == {UnknownSpace.forbidden: False, UnknownSpace.costly: True, UnknownSpace.free: True}
    assert all(costs.fits(costs.world(speck)) for costs in by.values())
    costly, free = by[UnknownSpace.costly].route_cost, by[UnknownSpace.free].route_cost
    assert costly[100, 140] == free[100, 140] + 1.0
    assert costly[60, 40] == free[60, 40]


@pytest.mark.parametrize("away", [0, 40, 300, 900])
def test_clearance_is_true_also_beyond_the_reach_of_the_distances(away):
    cells = np.full((200, 1000), -5.0, np.float32)
    cells[100, 980] = 5.0
    costs = costmap(OccupancyGrid(cells, 0.05, np.array([3.0, -1.0, 0.7])), QCAR, UnknownSpace.free)
    x = 980 * 0.05 - 0.3405 - away * 0.05 - 0.02
    poses = costs.world(np.array([[x, 5.02, 0.0], [max(x - 2.0, 1.0), 5.02, 0.0]]))
    assert costs.clearance_m(poses) == pytest.approx(away * 0.05 + 0.02, abs=1e-9)


def test_clearance_of_a_map_without_walls_is_infinite():
    costs = costmap(OccupancyGrid(np.full((50, 70), -5.0, np.float32), 0.05, np.zeros(3)), QCAR, UnknownSpace.free)
    assert costs.clearance_m(np.array([[1.0, 1.0, 0.0]])) == np.inf


@pytest.mark.parametrize("width", [0, 1, 2, 3, 4, 5, 6])
def test_a_gap_far_narrower_than_the_car_parts_regions_and_a_wider_one_never(width):
    cells = np.full((60, 80), -5.0, np.float32)
    cells[:, 40] = 5.0
    cells[30 : 30 + width, 40] = -5.0
    costs = costmap(OccupancyGrid(cells, 0.05, np.zeros(3)), QCAR, UnknownSpace.free)
    through = [
        costs.all_fit(np.array([[x, 1.5 + width * 0.025, yaw] for x in np.linspace(1.0, 3.0, 201)]))
        for yaw in (0.0, np.pi)
    ]
    assert any(through) == (width >= 5)
    joined = costs.region[31, 20] == costs.region[31, 60]
    assert joined or width < 5
    assert not joined or width > 2


def test_poses_far_outside_do_not_fit(rooms):
    costs = costmap(rooms, QCAR, UnknownSpace.free)
    for pose in (np.array([1e300, 0.0, 0.0]), se2.compose(rooms.origin, np.array([-0.001, 3.0, 0.0]))):
        assert not costs.fits(pose)
        assert costs.cell(pose) is None
