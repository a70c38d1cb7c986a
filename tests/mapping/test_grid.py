from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping.grid import LOG_ODDS_CLAMP, GridBuilder, OccupancyGrid
from mapping.raycast import cast_rays
from mapping.sensor_models import LidarModel

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROOM_CELL_M = 0.02
VIEWPOINTS = ((1.2, 1.5), (3.5, 3.0), (4.2, 5.1), (7.1, 1.1), (7.2, 5.2), (5.4, 2.2))


def scan_points(room: Mask, sensor: FloatArray) -> FloatArray:
    """Return where 720 exact rays from the sensor hit the room's walls."""
    headings = np.linspace(-np.pi, np.pi, 720, endpoint=False) + 1e-3  # not along the cell borders
    starts = np.tile(sensor / ROOM_CELL_M, (len(headings), 1))
    ranges = cast_rays(room, starts, headings, 1e3) * ROOM_CELL_M
    return sensor + ranges[:, np.newaxis] * np.column_stack([np.cos(headings), np.sin(headings)])


def map_of(room: Mask, *, resolution_m: float = 0.05) -> OccupancyGrid:
    builder = GridBuilder(resolution_m, LidarModel(max_range_m=20.0))
    for sensor in np.array(VIEWPOINTS):
        for _ in range(5):  # four misses of 40 % make a cell free
            builder.add_scan(sensor, scan_points(room, sensor))
    return builder.grid()


def solid_at(room: Mask, points: FloatArray, reach_m: float) -> tuple[Mask, Mask]:
    """Return whether each point (N, 2) has any wall, and any free cell, of the room within a square of +-reach_m."""
    reach = round(reach_m / ROOM_CELL_M)
    padded = np.pad(room, reach, constant_values=True)
    cells = np.floor(points / ROOM_CELL_M).astype(int)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
    inside = np.clip(cells, 0, np.array(room.shape[::-1]) - 1)
    around = windows[inside[:, 1], inside[:, 0]]
    return around.any(axis=(1, 2)), ~around.all(axis=(1, 2))


def test_walls_are_drawn_where_they_are_and_the_inside_is_free(room: Mask) -> None:
    grid = map_of(room)
    has_wall, has_free = solid_at(room, grid.cell_centers(*np.nonzero(grid.occupied)), reach_m=0.06)
    # A hit lies on the surface, its cell's centre at most 3.5 cm off; the room's own cells are 2 cm.
    assert has_wall.all()
    assert has_free.all()
    _, has_free = solid_at(room, grid.cell_centers(*np.nonzero(grid.free)), reach_m=0.04)
    assert has_free.all()
    free_area_m2 = np.count_nonzero(~room) * ROOM_CELL_M**2
    # What is missing is the cells that walls cut, and shadows of cupboard and pillar: a few per cent.
    assert np.count_nonzero(grid.free) * 0.05**2 == pytest.approx(free_area_m2, rel=0.05)


def test_every_wall_that_was_hit_is_on_the_map(room: Mask) -> None:
    grid = map_of(room)
    points = np.vstack([scan_points(room, sensor) for sensor in np.array(VIEWPOINTS)])
    cells = np.floor(grid.cell_coordinates(points) + 1e-9).astype(int)
    rows, cols = grid.log_odds.shape
    near = np.zeros(len(points), dtype=np.bool_)
    for row_step in (-1, 0, 1):  # a surface on a border between cells may fall to either side
        for col_step in (-1, 0, 1):
            row, col = cells[:, 1] + row_step, cells[:, 0] + col_step
            near |= grid.occupied[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)]
    # A cell at a corner that other viewpoints only pass may be outvoted: one point in a hundred.
    assert near.mean() > 0.99


def test_a_mirrored_or_transposed_map_does_not_fit(room: Mask) -> None:
    grid = map_of(room)
    free = grid.cell_centers(*np.nonzero(grid.free))
    width_m, height_m = np.array(room.shape[::-1]) * ROOM_CELL_M

    def wrong(points: FloatArray) -> float:
        return 1.0 - float(solid_at(room, points, reach_m=0.04)[1].mean())

    assert wrong(free) == 0.0
    for impostor in (
        np.column_stack([width_m - free[:, 0], free[:, 1]]),
        np.column_stack([free[:, 0], height_m - free[:, 1]]),
        np.column_stack([width_m - free[:, 0], height_m - free[:, 1]]),
        free[:, ::-1],
    ):
        assert wrong(impostor) > 0.05  # the niche alone is a tenth of the room


@pytest.mark.parametrize("resolution_m", [0.05, 0.1, 0.0125])
def test_origin_lies_on_whole_cells(room: Mask, resolution_m: float) -> None:
    builder = GridBuilder(resolution_m, LidarModel())
    builder.add_scan(np.array(VIEWPOINTS[0]), scan_points(room, np.array(VIEWPOINTS[0])))
    grid = builder.grid()
    in_cells = grid.origin[:2] / resolution_m
    np.testing.assert_allclose(in_cells, np.rint(in_cells), atol=1e-9)
    assert grid.known[0].any()
    assert grid.known[-1].any()
    assert grid.known[:, 0].any()
    assert grid.known[:, -1].any()


def test_growing_in_any_direction_keeps_the_evidence_in_its_place(room: Mask) -> None:
    shift = 4.013  # no wall on a border between cells: there, rounding alone decides
    scans = [(np.array(sensor) - shift, scan_points(room, np.array(sensor)) - shift) for sensor in VIEWPOINTS]
    far = (np.array([31.02, -42.03]), np.array([[33.0, -42.0], [29.0, -44.0]]))
    builders = [GridBuilder(0.05, LidarModel()) for _ in range(2)]
    for sensor, points in [*scans, far]:
        builders[0].add_scan(sensor, points)
    for sensor, points in [far, *scans]:
        builders[1].add_scan(sensor, points)
    one, other = builders[0].grid(), builders[1].grid()
    np.testing.assert_array_equal(one.origin, other.origin)
    # The order of float32 sums differs for no cell: the far scan shares none with the others.
    np.testing.assert_array_equal(one.log_odds, other.log_odds)


def test_points_just_below_the_upper_edge_of_the_array_stay_in_their_row() -> None:
    builder = GridBuilder(1.0, LidarModel(max_range_m=4.0))  # grows by margins of two cells
    builder.add_scan(np.array([-60000.5, 0.5]), np.array([[-60002.5, 0.5]]))
    builder.add_scan(np.array([0.5, 0.5]), np.array([[2.5, 0.5]]))  # the array now ends at x = 5
    edge = np.nextafter(5.0, 0.0)  # less the array's corner at -60005 this rounds up to the width of the array
    builder.add_scan(np.array([3.5, 0.5]), np.array([[edge, 0.5]]))
    grid = builder.grid()
    rows, cols = np.nonzero(grid.occupied)
    found = sorted(grid.cell_centers(rows, cols).tolist())
    assert [found[0], found[1]] == [[-60002.5, 0.5], [2.5, 0.5]]
    assert found[2] in ([4.5, 0.5], [5.5, 0.5])
    assert len(found) == 3


def test_rays_longer_than_the_model_clear_and_mark_nothing() -> None:
    builder = GridBuilder(0.1, LidarModel(max_range_m=3.0))
    builder.add_scan(np.array([0.05, 0.05]), np.array([[9.05, 0.05]]))
    grid = builder.grid()
    assert (grid.log_odds[grid.known] < 0.0).all()
    assert grid.log_odds.shape == (1, 30)


def test_nothing_seen_is_one_unknown_cell() -> None:
    builder = GridBuilder(0.05, LidarModel())
    builder.add_scan(np.zeros(2), np.zeros((0, 2)))
    grid = builder.grid()
    assert grid.log_odds.tolist() == [[0.0]]
    assert not grid.known.any()


def small_grid(origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    cells = np.zeros((3, 5), dtype=np.float32)
    cells[0, 4], cells[2, 1], cells[1, 1] = 2.0, -3.0, 0.3
    return OccupancyGrid(cells, 0.5, np.array(origin))


def test_probability_known_free_and_occupied() -> None:
    grid = small_grid()
    np.testing.assert_allclose(np.log(grid.probability / (1 - grid.probability)), grid.log_odds, atol=1e-6)
    assert np.argwhere(grid.known).tolist() == [[0, 4], [1, 1], [2, 1]]
    assert np.argwhere(grid.occupied).tolist() == [[0, 4]]
    assert np.argwhere(grid.free).tolist() == [[2, 1]]


def test_the_clamp_is_far_enough_from_the_thresholds() -> None:
    grid = OccupancyGrid(np.array([[-LOG_ODDS_CLAMP, LOG_ODDS_CLAMP]], np.float32), 1.0, np.zeros(3))
    assert grid.free.tolist() == [[True, False]]
    assert grid.occupied.tolist() == [[False, True]]
    assert grid.probability[0, 1] > 0.99  # the thesis's alpha


@given(st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.1, 3.1)))
def test_cell_centers_and_cell_coordinates_are_inverse(origin: tuple[float, float, float]) -> None:
    grid = small_grid(origin)
    rows, cols = np.nonzero(np.ones((3, 5)))
    coordinates = grid.cell_coordinates(grid.cell_centers(rows, cols))
    np.testing.assert_allclose(coordinates, np.column_stack([cols + 0.5, rows + 0.5]), atol=1e-11)


def test_origin_is_the_lower_left_corner_turned_by_its_yaw() -> None:
    grid = small_grid((10.0, 20.0, np.pi / 2))
    center = grid.cell_centers(np.array([0]), np.array([4]))[0]  # 2.25 m along the turned x axis, 0.25 m along y
    np.testing.assert_allclose(center, [10.0 - 0.25, 20.0 + 2.25], atol=1e-12)


@pytest.mark.parametrize(
    ("cells", "resolution_m", "origin", "words"),
    [
        (np.zeros(3), 0.05, np.zeros(3), "expected \\(rows, cols\\)"),
        (np.zeros((0, 3)), 0.05, np.zeros(3), "at least one cell"),
        (np.full((2, 2), np.nan), 0.05, np.zeros(3), "not finite"),
        (np.zeros((2, 2)), 0.0, np.zeros(3), "not positive"),
        (np.zeros((2, 2)), np.inf, np.zeros(3), "not positive"),
        (np.zeros((2, 2)), 0.05, np.zeros(2), "finite pose"),
        (np.zeros((2, 2)), 0.05, np.array([0.0, np.nan, 0.0]), "finite pose"),
    ],
)
def test_impossible_grids_are_refused(cells: FloatArray, resolution_m: float, origin: FloatArray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        OccupancyGrid(cells.astype(np.float32), resolution_m, origin)


def test_a_grid_cannot_be_changed() -> None:
    cells = np.zeros((2, 2), dtype=np.float32)
    grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    cells[0, 0] = 1.0
    assert not grid.known.any()
    with pytest.raises(ValueError, match="read-only"):
        grid.log_odds[0, 0] = 1.0
