from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.layer_correlation import coarse_layers, correlate
from mapping.wall_map import WallMap, wall_map

CELL_M = 0.05


def rooms() -> np.ndarray:
    """Three rooms of different sizes with doors, in cells of 5 cm: -1 free, 1 wall."""
    cells = np.zeros((260, 340), np.float32)
    for row, col, height, width in ((20, 20, 100, 150), (120, 20, 120, 90), (20, 170, 160, 140)):
        cells[row : row + height + 1, col : col + width + 1][
            cells[row : row + height + 1, col : col + width + 1] == 0
        ] = -1
        cells[[row, row + height], col : col + width + 1] = 1
        cells[row : row + height + 1, [col, col + width]] = 1
    cells[60:80, 170] = cells[120, 50:70] = -1
    return cells


def seen(cells: np.ndarray) -> WallMap:
    return wall_map(OccupancyGrid((3.0 * cells).astype(np.float32), CELL_M, np.zeros(3)), free_below=-0.62)


def turned(cells: np.ndarray, T_new_old: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The cells drawn anew where the old grid has the pose T_new_old in the new one's frame."""
    rows, cols = np.indices(shape)
    points = np.column_stack([cols.ravel() + 0.5, rows.ravel() + 0.5]) * CELL_M
    old = np.floor(se2.transform_points(se2.inverse(T_new_old), points) / CELL_M).astype(int)
    inside = (old >= 0).all(axis=1) & (old[:, 0] < cells.shape[1]) & (old[:, 1] < cells.shape[0])
    drawn = np.zeros(len(points), np.float32)
    drawn[inside] = cells[old[inside, 1], old[inside, 0]]
    return drawn.reshape(shape)


@pytest.mark.parametrize("angle_deg", [0.0, 31.0, 90.0, 179.0, -122.0, -45.0])
@pytest.mark.parametrize("cell_m", [0.1, 0.25])
def test_the_best_shift_is_the_true_one_to_a_coarse_cell(angle_deg, cell_m):
    cells = rooms()
    T_b_a = np.array([12.0, 11.0, np.radians(angle_deg)])
    b = turned(cells[:, :250], T_b_a, (480, 480))
    found = correlate(coarse_layers(seen(cells), cell_m), coarse_layers(seen(b), cell_m), turns=120, peaks_per_turn=2)
    middle = np.array([[6.0, 5.0]])
    placed = se2.transform_points(found.poses[0], se2.transform_points(T_b_a, middle))
    assert np.hypot(*(placed - middle)[0]) < 2.0 * cell_m
    assert abs(np.degrees(se2.wrap_angle(found.poses[0, 2] + T_b_a[2]))) <= 1.6
    assert (np.diff(found.scores) <= 0.0).all()
    assert len(found.poses) == 2 * 120


def test_layers_hold_the_share_of_wall_and_of_free_space():
    cells = np.zeros((40, 60), np.float32)
    cells[:, 10:50] = -1
    cells[:, 30] = 1  # a wall one cell thick
    layers = coarse_layers(seen(cells), 0.2)
    assert layers.wall.shape == (10, 15)
    assert layers.wall[:, 7] == pytest.approx(1.0, abs=0.02)
    assert layers.wall[:, [0, 3, 10]] == pytest.approx(0.0, abs=0.01)
    assert layers.free[:, 4] == pytest.approx(1.0, abs=0.01)
    assert (layers.free[:, 6:9] == 0.0).all()  # beside a wall no cell counts as free
    assert (layers.free[:, 13:] == 0.0).all()


def test_a_cell_size_that_is_no_multiple_keeps_the_places():
    cells = np.zeros((300, 300), np.float32)
    cells[200, 100:250] = 1
    layers = coarse_layers(seen(cells), 0.17)
    weight = layers.wall.sum(axis=1)
    middle_m = 0.17 * np.average(np.arange(len(weight)) + 0.5, weights=weight)
    assert middle_m == pytest.approx(200.5 * CELL_M, abs=0.17 / 2 + CELL_M / 2)
