from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping.raycast import cast_rays, integrate_rays

FloatArray = NDArray[np.float64]

CLAMP = 7.0


def box(rows: int = 40, cols: int = 60) -> NDArray[np.bool_]:
    """Return a room with walls one cell thick: free from x = 1 to cols - 1 and y = 1 to rows - 1."""
    occupied = np.ones((rows, cols), dtype=np.bool_)
    occupied[1:-1, 1:-1] = False
    return occupied


def distance_in_box(x: float, y: float, heading: float, rows: int = 40, cols: int = 60) -> float:
    """Return the distance to the first wall of `box` by plane geometry."""
    dx, dy = math.cos(heading), math.sin(heading)
    to_x = ((cols - 1 - x) / dx if dx > 0 else (1 - x) / dx) if dx != 0 else math.inf
    to_y = ((rows - 1 - y) / dy if dy > 0 else (1 - y) / dy) if dy != 0 else math.inf
    return min(to_x, to_y)


@given(st.floats(1.01, 58.99), st.floats(1.01, 38.99), st.floats(-7.0, 7.0))
def test_ranges_in_a_box_room_are_the_analytic_ones(x: float, y: float, heading: float) -> None:
    distance = cast_rays(box(), np.array([[x, y]]), np.array([heading]), 200.0)[0]
    # Sums of up to a hundred cell borders of size 1 / cos: relative rounding of 1e-14 with margin.
    assert distance == pytest.approx(distance_in_box(x, y, heading), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize(
    ("heading_deg", "distance"), [(0, 39.0), (90, 29.0), (180, 19.0), (-90, 9.0), (-180, 19.0), (270, 9.0)]
)
def test_ranges_along_the_axes_from_a_cell_corner(heading_deg: float, distance: float) -> None:
    found = cast_rays(box(), np.array([[20.0, 10.0]]), np.radians([heading_deg]), 200.0)[0]
    assert found == pytest.approx(distance, abs=1e-9)


def test_rows_are_y_and_columns_are_x() -> None:
    occupied = np.zeros((20, 30), dtype=np.bool_)
    occupied[5, 17] = True  # x 17..18, y 5..6
    starts = np.array([[2.5, 5.5], [17.5, 12.5], [5.5, 2.5]])
    found = cast_rays(occupied, starts, np.radians([0.0, -90.0, 0.0]), 100.0)
    np.testing.assert_allclose(found, [14.5, 6.5, 0.0], atol=1e-9)


def test_nothing_is_hit_beyond_the_reach_and_outside_the_grid() -> None:
    start = np.array([[20.5, 20.5]])
    assert cast_rays(box(), start, np.zeros(1), 38.0)[0] == 0.0  # the wall is 38.5 away
    assert cast_rays(box(), start, np.zeros(1), 39.0)[0] == pytest.approx(38.5)
    assert cast_rays(np.zeros((40, 60), np.bool_), start, np.array([0.3]), 1e6)[0] == 0.0
    assert cast_rays(box(), np.array([[-5.0, 20.0]]), np.zeros(1), 100.0)[0] == 0.0


def integrated(
    start: tuple[float, float],
    ends: list[tuple[float, float]],
    hits: list[bool],
    log_odds: NDArray[np.float32] | None = None,
    *,
    visit: int = 1,
    hit: float = 0.8,
    miss: float = -0.4,
) -> NDArray[np.float32]:
    grid = np.zeros((40, 60), dtype=np.float32) if log_odds is None else log_odds.copy()
    visited = np.zeros(grid.shape, dtype=np.int32)
    evidence = np.full(len(ends), hit)
    integrate_rays(grid, visited, visit, np.array(start), np.array(ends), np.array(hits), evidence, miss, CLAMP)
    return grid


INSIDE = st.tuples(st.floats(0.01, 59.99), st.floats(0.01, 39.99))


@given(INSIDE, INSIDE)
def test_traversed_cells_are_on_the_segment_and_connected(start: tuple[float, float], end: tuple[float, float]) -> None:
    grid = integrated(start, [end], [False])
    rows, cols = np.nonzero(grid)
    first, last = np.array(start), np.array(end)
    cells_apart = abs(int(last[0]) - int(first[0])) + abs(int(last[1]) - int(first[1]))
    # Each border between the end cells is crossed once; the last cell stays untouched by a ray that hits nothing.
    assert len(rows) == cells_apart
    assert grid[int(last[1]), int(last[0])] == 0.0
    length = np.hypot(*(last - first))
    for row, col in zip(rows, cols, strict=True):
        corners = np.array([[col, row], [col + 1, row], [col, row + 1], [col + 1, row + 1]]) - first
        side = (corners[:, 0] * (last - first)[1] - corners[:, 1] * (last - first)[0]) / length
        assert side.min() <= 1e-9  # the line runs between the cell's corners, or through one of them
        assert side.max() >= -1e-9


def test_a_hit_marks_its_cell_and_clears_the_way() -> None:
    grid = integrated((2.5, 3.5), [(8.5, 3.5)], [True])
    expected = np.zeros_like(grid)
    expected[3, 2:8] = -0.4
    expected[3, 8] = 0.8
    np.testing.assert_allclose(grid, expected, atol=1e-6)


def test_a_ray_down_and_left_visits_the_same_cells() -> None:
    there, back = integrated((2.3, 3.4), [(25.6, 31.2)], [False]), integrated((25.6, 31.2), [(2.3, 3.4)], [False])
    there[31, 25], back[3, 2] = -0.4, -0.4  # the end cell of either
    np.testing.assert_array_equal(there, back)


def test_many_rays_through_a_cell_are_one_observation() -> None:
    ends = [(30.5, 20.1 + 0.01 * index) for index in range(50)]
    grid = integrated((2.5, 20.5), ends, [True] * 50)
    assert grid[20, 30] == pytest.approx(0.8)
    assert grid[20, 10] == pytest.approx(-0.4)


def test_a_hit_outweighs_the_misses_of_the_same_scan() -> None:
    rays = [(20.5, 20.5), (10.5, 20.5)]  # the first passes the cell in which the second ends
    for ends in (rays, rays[::-1]):
        assert integrated((2.5, 20.5), ends, [True, True])[20, 10] == pytest.approx(0.8)


def test_evidence_adds_up_over_scans_to_the_clamp() -> None:
    grid = np.zeros((40, 60), dtype=np.float32)
    for scan in range(1, 40):
        grid = integrated((2.5, 3.5), [(8.5, 3.5)], [True], grid, visit=scan)
        assert grid[3, 8] == pytest.approx(min(0.8 * scan, CLAMP), rel=1e-5)
        assert grid[3, 5] == pytest.approx(max(-0.4 * scan, -CLAMP), rel=1e-5)


def test_a_known_cell_whose_evidence_cancels_stays_known() -> None:
    once = integrated((2.5, 3.5), [(8.5, 3.5)], [True], hit=0.5)
    then = integrated((2.5, 3.5), [(12.5, 3.5)], [False], once, visit=2, miss=-0.5)
    assert then[3, 8] != 0.0
    assert abs(then[3, 8]) < 0.01


def test_a_ray_without_length_marks_its_cell_only() -> None:
    grid = integrated((2.5, 3.5), [(2.5, 3.5)], [True])
    assert np.count_nonzero(grid) == 1
    assert grid[3, 2] == pytest.approx(0.8)
