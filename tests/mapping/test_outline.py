from __future__ import annotations

import math

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.outline import Outline, outline_of
from mapping.wall_map import wall_map

CELL_M = 0.05


def half_plane(angle_rad: float, thickness_m: float = 0.3) -> Outline:
    """The outline of a straight wall through the middle of 10 x 10 m, free on one side of it."""
    rows, cols = np.indices((200, 200))
    local = se2.transform_points(
        se2.inverse(np.array([5.0, 5.0, angle_rad])), np.column_stack([cols.ravel() + 0.5, rows.ravel() + 0.5]) * CELL_M
    )
    across, along = local[:, 1].reshape(200, 200), local[:, 0].reshape(200, 200)
    cells = np.zeros((200, 200), np.float32)
    cells[(across < 0.0) & (np.abs(along) < 4.0)] = -3.0
    cells[(across >= 0.0) & (across < thickness_m) & (np.abs(along) < 4.0)] = 3.0
    return outline_of(wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62))


@pytest.mark.parametrize("angle_deg", [0, 17, 30, 45, 60, 90, 133])
def test_a_wall_is_as_long_at_any_angle(angle_deg):
    outline = half_plane(math.radians(angle_deg))
    assert outline.lengths.sum() == pytest.approx(8.0, rel=0.06)


@pytest.mark.parametrize("angle_deg", [0, 17, 30, 45, 60, 90, 133])
def test_normals_point_across_the_wall(angle_deg):
    outline = half_plane(math.radians(angle_deg))
    normal = np.array([-math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))])
    clear = (outline.normals != 0.0).any(axis=1)
    assert clear.mean() > 0.95
    assert np.median(np.abs(outline.normals[clear] @ normal)) > math.cos(math.radians(4.0))
    assert np.hypot(*outline.normals[clear].T) == pytest.approx(1.0)
    assert outline.faced.mean() > 0.9
    assert (outline.normals[outline.faced] @ -normal > 0.0).all()  # towards the free side


def test_a_wall_of_one_cell_seen_from_both_sides_faces_neither():
    cells = np.full((60, 60), -3.0, np.float32)
    cells[30, 5:55] = 3.0
    outline = outline_of(wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62))
    assert not outline.faced[(outline.points[:, 0] > 0.5) & (outline.points[:, 0] < 2.5)].any()


def test_the_two_sides_of_a_thick_wall_face_apart():
    cells = np.full((60, 60), -3.0, np.float32)
    cells[30:33, 5:55] = 3.0
    outline = outline_of(wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62))
    inside = (outline.points[:, 0] > 0.5) & (outline.points[:, 0] < 2.5)
    low = outline.points[:, 1] < 31 * CELL_M
    assert outline.faced[inside].all()
    assert (outline.normals[inside & low, 1] < 0.0).all()
    assert (outline.normals[inside & ~low, 1] > 0.0).all()


def test_only_what_borders_on_free_space_is_outline():
    cells = np.full((40, 40), 3.0, np.float32)
    cells[10:30, 10:30] = -3.0
    outline = outline_of(wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62))
    assert len(outline.points) == 4 * 20
    assert outline.points.min() == pytest.approx(9.5 * CELL_M)
    assert outline.points.max() == pytest.approx(30.5 * CELL_M)


def test_a_map_without_walls_or_free_space_has_none():
    for value in (0.0, 3.0, -3.0):
        grid = OccupancyGrid(np.full((5, 7), value, np.float32), CELL_M, np.zeros(3))
        assert len(outline_of(wall_map(grid, free_below=-0.62)).points) == 0
