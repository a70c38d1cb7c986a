"""The layer of free space, and its change of resolution."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.free_space import UNKNOWN, free_layer, rescale
from mapping.grid import LOG_ODDS_CLAMP, OccupancyGrid
from mapping.sensor_models import log_odds


def test_unknown_occupied_and_doubtful_cells_are_left_out():
    cells = np.array([[0.0, 3.0, log_odds(0.4), log_odds(0.02)]], np.float32)
    grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    assert free_layer(grid, 0.5).tolist() == [[0, 0, 153, 250]]
    assert free_layer(grid, 0.95).tolist() == [[0, 0, 0, 250]]


def test_alpha_0_is_the_map_itself():
    cells = np.array([[0.0, log_odds(0.9), log_odds(0.4)]], np.float32)
    assert free_layer(OccupancyGrid(cells, 0.05, np.zeros(3)), 0.0).tolist() == [[UNKNOWN, 26, 153]]


def test_cells_reach_the_alpha_of_the_thesis():
    grid = OccupancyGrid(np.full((1, 1), -LOG_ODDS_CLAMP, np.float32), 0.05, np.zeros(3))
    assert free_layer(grid, 0.99).all()


@pytest.mark.parametrize(("from_m", "to_m"), [(0.05, 0.05), (0.04, 0.10), (0.05, 0.07), (0.10, 0.05)])
def test_a_rescaled_layer_shows_the_same_place_at_the_same_distance(from_m, to_m):
    layer = np.zeros((300, 400), np.uint8)
    layer[round(6.0 / from_m) :, round(8.0 / from_m) :] = 255
    scaled = rescale(layer, from_m, to_m)
    rows, cols = np.nonzero(scaled)
    assert rows.min() * to_m == pytest.approx(6.0, abs=to_m)
    assert cols.min() * to_m == pytest.approx(8.0, abs=to_m)
    assert scaled.shape[0] * to_m == pytest.approx(300 * from_m, abs=to_m)


def test_a_layer_smaller_than_a_cell_stays_one_cell():
    assert rescale(np.full((2, 2), 9, np.uint8), 0.05, 1.0).tolist() == [[9]]
