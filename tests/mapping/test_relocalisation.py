from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.raycast import cast_rays
from mapping.reference_map import reference_map
from mapping.relocalisation import Located, RelocalisationSettings, Relocaliser

CELL_M = 0.05
BEAMS = 360


def building(rooms: int = 3, *, furnished: bool = True) -> np.ndarray:
    """Wall cells (rows, cols) of rooms of 5 x 4 m in a row behind each other along a corridor of 2 m.

    furnished: every room has another cupboard and pillar; otherwise all are alike.
    """
    cells = np.zeros((130, rooms * 100 + 2), np.bool_)
    cells[[0, 1, -1, -2]] = cells[:, [0, 1, -1, -2]] = True
    cells[40:42] = True
    for room in range(rooms):
        left = room * 100
        cells[40:, left : left + 2] = True
        cells[40:42, left + 40 : left + 60] = False
        if furnished:
            cells[42 : 60 + 8 * room, left + 70 - 12 * room : left + 84 - 12 * room] = True
            cells[90 - 15 * room : 96 - 15 * room, left + 20 + 9 * room : left + 26 + 9 * room] = True
            cells[2 : 6 + 2 * room, left + 10 + 14 * room : left + 24 + 17 * room] = True
    return cells


def grid_of(cells: np.ndarray, origin: np.ndarray | None = None) -> OccupancyGrid:
    log_odds = np.where(cells, 3.0, -3.0).astype(np.float32)
    return OccupancyGrid(log_odds, CELL_M, np.zeros(3) if origin is None else origin)


def scan_at(cells: np.ndarray, pose: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Return body-frame points (N, 2) of a scan with 1 cm of noise; pose (3,) in the cells' frame."""
    headings = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
    starts = np.repeat(pose[np.newaxis, :2] / CELL_M, BEAMS, axis=0)
    ranges = cast_rays(cells, starts, headings + pose[2], 12.0 / CELL_M) * CELL_M
    seen = ranges > 0
    ranges = ranges[seen] + 0.02 + generator.normal(0.0, 0.01, int(seen.sum()))
    return np.column_stack([np.cos(headings[seen]), np.sin(headings[seen])]) * ranges[:, np.newaxis]


def drive(cells: np.ndarray, relocaliser: Relocaliser, start: np.ndarray, steps: int = 50) -> tuple:
    """Drive 0.1 m a step straight on, odometry off by 1 %; return what was found and the true pose there."""
    generator = np.random.default_rng(5)
    T_odom_start = np.array([7.0, -3.0, 2.0])
    for step in range(steps):
        pose = se2.compose(start, [0.1 * step, 0.0, 0.0])
        T_odom_base = se2.compose(T_odom_start, [0.101 * step, 0.0, 0.0])
        found = relocaliser.add(step, scan_at(cells, pose, generator), T_odom_base)
        if found is not None:
            return found, pose, T_odom_base
    return None, pose, T_odom_base


STARTS = [np.array([1.0, 1.2, 0.1]), np.array([2.5, 1.0, 1.5]), np.array([13.0, 1.1, 3.1]), np.array([7.5, 5.5, -1.5])]


@pytest.mark.parametrize("start", STARTS)
def test_the_place_is_found_without_a_prior(start):
    cells = building()
    relocaliser = Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings())
    found, pose, T_odom_base = drive(cells, relocaliser, start, steps=40)
    assert isinstance(found, Located), relocaliser.reason
    error = se2.between(pose, found.T_map_base)
    assert np.hypot(*error[:2]) < 0.15
    assert abs(error[2]) < np.radians(2.0)
    np.testing.assert_allclose(se2.compose(found.T_map_odom, T_odom_base), found.T_map_base, atol=1e-9)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    assert 0.7 < found.score <= 1.0


def test_the_map_may_have_any_origin():
    cells = building()
    origin = np.array([-4.0, 11.0, 0.7])
    relocaliser = Relocaliser(reference_map(grid_of(cells, origin)), RelocalisationSettings())
    found, pose, _ = drive(cells, relocaliser, STARTS[0])
    error = se2.between(se2.compose(origin, pose), found.T_map_base)
    assert np.hypot(*error[:2]) < 0.15
    assert abs(error[2]) < np.radians(2.0)


def test_the_place_of_the_laser_on_the_body_is_heeded():
    cells = building()
    sensor = np.array([0.3, 0.1])
    relocaliser = Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings(), sensor)
    generator = np.random.default_rng(5)
    for step in range(40):
        pose = se2.compose(STARTS[0], [0.1 * step, 0.0, 0.0])
        points = scan_at(cells, se2.compose(pose, [*sensor, 0.0]), generator) + sensor
        found = relocaliser.add(step, points, np.array([0.1 * step, 0.0, 0.0]))
        if found is not None:
            break
    assert np.hypot(*se2.between(pose, found.T_map_base)[:2]) < 0.15


def test_a_room_that_was_only_looked_into_is_found_where_it_is(looked_into):
    cells, grid = looked_into
    relocaliser, generator = Relocaliser(reference_map(grid), RelocalisationSettings()), np.random.default_rng(2)
    for step in range(60):
        T_odom_base = se2.exp(np.array([0.1, 0.0, 0.1 / 0.9]) * step)
        pose = se2.compose([5.4, 1.6, 0.3], T_odom_base)
        cell_m = 0.02
        headings = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
        starts = np.tile(pose[:2] / cell_m, (BEAMS, 1))
        ranges = cast_rays(cells, starts, headings + pose[2], 12.0 / cell_m) * cell_m + generator.normal(
            0.0, 0.01, BEAMS
        )
        points = np.column_stack([np.cos(headings), np.sin(headings)]) * ranges[:, np.newaxis]
        found = relocaliser.add(step, points, T_odom_base)
        if found is not None:
            break
    assert found is not None, relocaliser.reason
    assert np.hypot(*se2.between(pose, found.T_map_base)[:2]) < 0.04


def test_rooms_that_are_alike_are_not_told_apart():
    cells = building(furnished=False)
    relocaliser = Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings())
    found, _, _ = drive(cells, relocaliser, np.array([6.5, 3.2, 0.9]), steps=25)
    assert found is None
    assert "ambiguous" in relocaliser.reason


def test_a_symmetric_room_is_not_found():
    cells = np.zeros((100, 120), np.bool_)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = True
    relocaliser = Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings())
    found, _, _ = drive(cells, relocaliser, np.array([1.0, 1.3, 0.5]), steps=40)
    assert found is None
    assert "ambiguous" in relocaliser.reason


def test_a_bare_corridor_does_not_pin_the_place_down():
    cells = np.zeros((44, 1200), np.bool_)
    cells[:2] = cells[-2:] = True
    relocaliser = Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings())
    found, _, _ = drive(cells, relocaliser, np.array([30.0, 1.0, 0.02]), steps=40)
    assert found is None
    assert relocaliser.searches > 3


@pytest.mark.parametrize("seed", range(3))
def test_another_building_is_never_found(seed):
    generator = np.random.default_rng(seed)
    other = np.zeros((160, 240), np.bool_)
    other[:2] = other[-2:] = other[:, :2] = other[:, -2:] = True
    for _ in range(9):
        row, col = generator.integers(5, (130, 210))
        other[row : row + generator.integers(4, 30), col : col + generator.integers(4, 30)] = True
    relocaliser = Relocaliser(reference_map(grid_of(other)), RelocalisationSettings())
    for start in STARTS:
        found, _, _ = drive(building(), relocaliser, start, steps=40)
        assert found is None


def test_the_same_scans_give_the_same_place_bit_for_bit():
    cells = building()
    results = [
        drive(cells, Relocaliser(reference_map(grid_of(cells)), RelocalisationSettings()), STARTS[1])[0]
        for _ in range(2)
    ]
    np.testing.assert_array_equal(results[0].T_map_base, results[1].T_map_base)
    np.testing.assert_array_equal(results[0].covariance, results[1].covariance)
    assert results[0].stamp_ns == results[1].stamp_ns


@pytest.mark.parametrize(
    "log_odds",
    [np.zeros((1, 1)), np.full((1, 1), 3.0), np.full((1, 1), -3.0), np.zeros((40, 50)), np.full((40, 50), 3.0)],
    ids=["unknown cell", "wall cell", "free cell", "all unknown", "all wall"],
)
def test_maps_without_content_find_nothing(log_odds):
    grid = OccupancyGrid(log_odds.astype(np.float32), CELL_M, np.zeros(3))
    relocaliser = Relocaliser(reference_map(grid), RelocalisationSettings())
    found, _, _ = drive(building(), relocaliser, STARTS[0], steps=15)
    assert found is None
    assert relocaliser.reason


def test_scans_without_measurements_are_survived():
    relocaliser = Relocaliser(reference_map(grid_of(building())), RelocalisationSettings())
    assert relocaliser.add(0, np.zeros((0, 2)), np.zeros(3)) is None
    assert "0 points seen" in relocaliser.reason
