"""A costmap after changes in a window is the one that a rebuild gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.costmap_update import Window, update
from planning.errors import PlanningError
from planning.vehicle import Vehicle

SMALL = Vehicle(((-0.1, -0.15), (0.3, -0.15), (0.3, 0.15), (-0.1, 0.15)))
KINDS = np.array([-5.0, 0.0, 5.0], np.float32)  # free, unseen, occupied


def assert_same(updated: Costmap, rebuilt: Costmap) -> None:
    for name in ("occupied", "blocked", "to_occupied_m", "to_blocked_m", "route_cost"):
        np.testing.assert_array_equal(getattr(updated, name), getattr(rebuilt, name), err_msg=name)
    # The same partition: numbers correspond one to one, and 0 is 0.
    pairs = np.unique(np.column_stack([updated.region.ravel(), rebuilt.region.ravel()]), axis=0)
    assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs)
    assert ((pairs[:, 0] == 0) == (pairs[:, 1] == 0)).all()
    assert updated.region.max(initial=0) < updated.regions


def scattered(random: np.random.Generator, shape: tuple[int, int], coarse: int) -> np.ndarray:
    """Blocks of cells of each kind, most of them free."""
    blocks = random.choice(KINDS, (shape[0] // coarse + 1, shape[1] // coarse + 1), p=[0.8, 0.12, 0.08])
    return np.kron(blocks, np.ones((coarse, coarse), np.float32))[: shape[0], : shape[1]]


@pytest.mark.parametrize("unknown", list(UnknownSpace))
@given(seed=st.integers(0, 2**32 - 1), cell_m=st.sampled_from([0.1, 0.2, 0.45]), coarse=st.integers(1, 5))
@settings(max_examples=15, deadline=None)
def test_a_chain_of_changes_gives_what_a_rebuild_gives(unknown, seed, cell_m, coarse):
    random = np.random.default_rng(seed)
    cells = scattered(random, (70, 90), coarse)
    costs = costmap(OccupancyGrid(cells, cell_m, np.array([1.0, 2.0, 0.3])), SMALL, unknown)
    for _ in range(4):
        top, left = int(random.integers(0, 65)), int(random.integers(0, 85))
        window = Window(top, left, top + int(random.integers(1, 25)), left + int(random.integers(1, 25)))
        cells = cells.copy()
        part = cells[window.cells]
        cells[window.cells] = random.choice([-5.0, 5.0]) if random.random() < 0.4 else scattered(random, part.shape, 2)
        grid = OccupancyGrid(cells, cell_m, np.array([1.0, 2.0, 0.3]))
        costs = update(costs, grid, window)
        assert costs.grid is grid
        assert_same(costs, costmap(grid, SMALL, unknown))


def test_a_door_that_closes_parts_the_rooms_and_joins_them_again(rooms):
    costs = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    left, right = (60, 30), (60, 110)
    assert costs.region[left] == costs.region[right] > 0
    shut = rooms.log_odds.copy()
    shut[50:70, 80] = 5.0
    costs = update(costs, replace(rooms, log_odds=shut), Window(50, 80, 70, 81))
    assert 0 != costs.region[left] != costs.region[right] != 0
    costs = update(costs, rooms, Window(50, 80, 70, 81))
    assert costs.region[left] == costs.region[right] > 0
    assert_same(costs, costmap(rooms, Vehicle(), UnknownSpace.forbidden))


def test_a_box_in_the_open_keeps_the_regions_array(rooms):
    costs = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    cells = rooms.log_odds.copy()
    cells[58:62, 28:32] = 5.0
    updated = update(costs, replace(rooms, log_odds=cells), Window(50, 20, 70, 40))
    assert updated.region is costs.region
    assert_same(updated, costmap(updated.grid, Vehicle(), UnknownSpace.forbidden))


def test_a_patch_grows_from_a_speck_to_an_obstacle_and_back(rooms):
    seen, hole = rooms.log_odds.copy(), rooms.log_odds.copy()
    hole[20:30, 30:40] = 0.0  # as large as the car
    hole[20, 20:30] = 0.0
    costs = costmap(rooms, Vehicle(), UnknownSpace.forbidden)
    assert not costs.blocked[20, 30]
    costs = update(costs, replace(rooms, log_odds=hole), Window(20, 20, 30, 40))
    assert costs.blocked[20, 20]
    without = hole.copy()
    without[20:30, 31:40] = -5.0
    costs = update(costs, replace(rooms, log_odds=without), Window(20, 31, 30, 40))
    assert not costs.blocked[20, 20]
    assert_same(costs, costmap(costs.grid, Vehicle(), UnknownSpace.forbidden))
    assert_same(
        update(costs, replace(rooms, log_odds=seen), Window(0, 0, 120, 160)),
        costmap(rooms, Vehicle(), UnknownSpace.forbidden),
    )


def test_nothing_changed_changes_nothing(rooms):
    costs = costmap(rooms, Vehicle(), UnknownSpace.costly)
    updated = update(costs, rooms, Window(-5, -5, 1000, 1000))
    assert all(getattr(updated, name) is getattr(costs, name) for name in ("region", "blocked", "route_cost"))
    assert update(costs, rooms, Window(30, 30, 30, 30)).grid is rooms


def test_a_map_of_another_shape_or_place_is_refused(rooms):
    costs = costmap(rooms, Vehicle(), UnknownSpace.free)
    for other in (
        replace(rooms, log_odds=rooms.log_odds[:-1]),
        replace(rooms, resolution_m=0.04),
        replace(rooms, origin=np.zeros(3)),
    ):
        with pytest.raises(PlanningError, match="make a new costmap"):
            update(costs, other, Window(0, 0, 10, 10))
