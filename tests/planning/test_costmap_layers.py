"""Each array of a costmap against its definition, cell by cell."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from planning import costmap_layers as layers
from planning.vehicle import Vehicle


def test_kinds_of_cells_are_those_of_the_grid():
    values = np.linspace(-7.0, 7.0, 1401, dtype=np.float32)[np.newaxis]
    values[0, 3] = 0.0
    grid = OccupancyGrid(values, 0.05, np.zeros(3))
    occupied, unseen = layers.occupied_and_unseen(values)
    np.testing.assert_array_equal(occupied, grid.occupied)
    np.testing.assert_array_equal(unseen, ~grid.occupied & (values >= 0.0))


@pytest.mark.parametrize("most_m", [0.7, 5.0])
def test_distances_are_those_to_the_nearest_cell(most_m):
    random = np.random.default_rng(3)
    mask = random.random((23, 31)) < 0.02
    rows, cols = np.mgrid[: mask.shape[0], : mask.shape[1]]
    blocked = np.argwhere(mask)
    expected = np.hypot(rows[..., None] - blocked[:, 0], cols[..., None] - blocked[:, 1]).min(axis=-1) * 0.05
    np.testing.assert_allclose(layers.distances_m(mask, 0.05, most_m), np.minimum(expected, most_m), rtol=1e-6)
    assert (layers.distances_m(np.zeros_like(mask), 0.05, most_m) == np.float32(most_m)).all()


def test_patches_are_specks_by_their_number_of_cells():
    mask = np.zeros((20, 20), bool)
    mask[2, 2:6] = True  # four
    mask[3, 6] = True  # touches by a corner only: one
    mask[10:13, 10:12] = True  # six
    np.testing.assert_array_equal(np.argwhere(layers.without_specks(mask, 5.0)), np.argwhere(mask)[5:])
    np.testing.assert_array_equal(layers.without_specks(mask, 0.5), mask)
    assert not layers.without_specks(mask, 6.5).any()


@pytest.mark.parametrize("seed", range(30))
def test_specks_around_a_change_are_those_of_the_whole_map(seed):
    random = np.random.default_rng(seed)
    old = random.random((60, 60)) < 0.55
    new = old.copy()
    new[25:35, 25:35] = random.random((10, 10)) < 0.6
    before, expected = layers.without_specks(old, 9.5), layers.without_specks(new, 9.5)
    part, changed = (slice(14, 46), slice(14, 46)), np.zeros((32, 32), bool)
    changed[10:22, 10:22] = True
    result = layers.without_specks_again(
        np.ascontiguousarray(new[part]), 9.5, changed, before[part], (True, True, True, True)
    )
    np.testing.assert_array_equal(result, expected[part])
    outside = np.ones((60, 60), bool)
    outside[part] = False
    np.testing.assert_array_equal(before[outside], expected[outside])


@pytest.mark.parametrize("cell_m", [0.02, 0.05, 0.1, 0.3, 1.0])
def test_the_bound_is_necessary_wherever_in_its_cell_the_axle_is(cell_m):
    """No free disc about a point of a cell is ever in a cell that is called impassable, and some are close to it."""
    car = Vehicle()
    least_m = layers.passable_from_m(car, cell_m)
    random = np.random.default_rng(5)
    tightest = np.inf
    for _ in range(4000):
        axle = random.uniform(-0.5, 0.5, 2) * cell_m
        row, col = random.integers(-6, 7, 2)
        outside = np.maximum(np.abs(np.array([col, row]) * cell_m - axle) - cell_m / 2, 0.0)
        if np.hypot(*outside) >= car.inradius_m:
            assert np.hypot(row, col) * cell_m >= least_m
            tightest = min(tightest, float(np.hypot(row, col)) * cell_m)
    assert tightest < least_m + 2 * cell_m


def test_costs_rise_towards_walls_and_on_unseen_space():
    distances = np.array([[0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 2.0]], np.float32)
    unseen = np.zeros(distances.shape, bool)
    costs = layers.route_costs(distances, unseen, 0.09, 0.1, 1.0)[0]
    assert np.isinf(costs[:2]).all()
    assert costs[2] == pytest.approx(2.0)
    assert (np.diff(costs[2:]) <= 0.0).all()
    assert costs[-2:].tolist() == [1.0, 1.0]
    np.testing.assert_allclose(layers.route_costs(distances, ~unseen, 0.09, 0.1, 1.0)[0], costs + 1.0)
