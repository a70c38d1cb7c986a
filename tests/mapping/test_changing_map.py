"""A saved room in which a box appears and a wall goes."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.changing_map import ChangingMap
from mapping.grid import OccupancyGrid
from mapping.sensor_models import LidarModel

ORIGIN = np.array([-3.0, 2.0, 0.6])
MODEL = LidarModel()


@pytest.fixture
def saved():
    """4 m x 3 m at 0.05 m, seen free for sure, walls around, and one across the middle of its lower half."""
    cells = np.full((60, 80), -7.0, np.float32)
    cells[[0, -1], :] = 7.0
    cells[:, [0, -1]] = 7.0
    cells[:30, 40] = 7.0
    return OccupancyGrid(cells, 0.05, ORIGIN)


def world(*points):
    """Points of the grid's own axes in the map frame."""
    return se2.transform_points(ORIGIN, np.array(points, dtype=np.float64))


def occupied(grid, x, y):
    return bool(grid.occupied[int(y / 0.05), int(x / 0.05)])


def test_a_box_is_marked_after_a_few_scans_and_cleared_when_it_is_gone(saved):
    changing = ChangingMap(saved, MODEL)
    sensor = world((1.0, 2.0))[0]
    box = world((2.02, 2.0), (2.02, 2.04))
    changing.add_scan(sensor, box)
    assert not occupied(changing.grid(), 2.02, 2.02)
    for _ in range(3):
        changing.add_scan(sensor, box)
    assert occupied(changing.grid(), 2.02, 2.02)
    behind = world((3.97, 2.0), (3.97, 2.04))
    for _ in range(8):
        changing.add_scan(sensor, behind)
    assert not occupied(changing.grid(), 2.02, 2.02)


def test_walls_do_not_grow_where_hits_scatter_around_them(saved):
    changing = ChangingMap(saved, MODEL)
    random = np.random.default_rng(0)
    for _ in range(50):
        y = np.arange(0.3, 1.4, 0.02)
        hits = np.column_stack([2.025 + random.normal(0.0, 0.02, len(y)), y])
        changing.add_scan(world((1.0, 0.8))[0], world(*hits))
    np.testing.assert_array_equal(changing.grid().occupied, saved.occupied)


def test_a_wall_that_is_gone_is_given_up_slowly(saved):
    changing = ChangingMap(saved, MODEL)
    sensor, behind = world((1.0, 1.0))[0], world((3.0, 1.0), (3.0, 1.02))
    scans = 0
    while occupied(changing.grid(), 2.02, 1.0):
        changing.add_scan(sensor, behind)
        scans += 1
        assert scans < 20
    assert scans > 4


def test_only_the_window_that_is_told_changes(saved):
    changing = ChangingMap(saved, MODEL)
    before = changing.grid().log_odds
    window = changing.add_scan(world((1.0, 2.0))[0], world((2.0, 2.2), (1.5, 1.6)))
    assert window is not None
    top, left, bottom, right = window
    differs = before != changing.grid().log_odds
    assert differs.any()
    differs[top:bottom, left:right] = False
    assert not differs.any()


def test_readings_beyond_the_map_clear_up_to_its_edge_and_a_sensor_outside_tells_nothing(saved):
    changing = ChangingMap(saved, MODEL)
    window = changing.add_scan(world((1.0, 2.0))[0], world((1.0, 9.0), (-6.0, 2.0), (1.0, 2.0)))
    assert window is not None
    assert np.isfinite(changing.grid().log_odds).all()
    assert changing.add_scan(world((-1.0, 2.0))[0], world((2.0, 2.0))) is None
    assert changing.add_scan(world((1.0, 2.0))[0], np.zeros((0, 2))) is None


def test_what_is_far_away_is_not_marked(saved):
    near = ChangingMap(saved, LidarModel(max_range_m=1.0))
    for _ in range(10):
        near.add_scan(world((1.0, 2.0))[0], world((2.5, 2.0)))
    assert not occupied(near.grid(), 2.5, 2.0)


def test_the_other_face_of_a_saved_wall_is_marked_where_it_is():
    cells = np.zeros((60, 80), np.float32)
    cells[32:, 1:-1] = -7.0  # free above, nothing known below
    cells[30:32, 1:-1] = 7.0  # the upper face, blurred over 1.5 to 1.6 m
    changing = ChangingMap(OccupancyGrid(cells, 0.05, ORIGIN), MODEL)
    random, x = np.random.default_rng(0), np.arange(1.0, 3.0, 0.02)
    for _ in range(20):
        lower = np.column_stack([x, 1.475 + random.normal(0.0, 0.005, len(x))])
        changing.add_scan(world((2.0, 0.5))[0], world(*lower))
    now = changing.grid().occupied
    assert now[29, 21:59].all()
    assert now[30:32, 1:-1].all()
    for _ in range(20):
        upper = np.column_stack([x, 1.625 + random.normal(0.0, 0.005, len(x))])
        changing.add_scan(world((2.0, 2.5))[0], world(*upper))
    np.testing.assert_array_equal(changing.grid().occupied, now)
