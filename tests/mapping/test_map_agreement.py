from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_agreement import (
    Agreements,
    compare_cells,
    judge_poses,
    limits_m,
    net_metres,
    place,
    probe_of,
    surface_of,
)
from mapping.outline import outline_of
from mapping.wall_map import FREE, WALL, WallMap, wall_map

CELL_M = 0.05
HERE = np.zeros((1, 3))


def room(door: bool = False) -> WallMap:
    """A room of 4 x 3 m with a thin wall across at 1.5 m, in a grid of 5 x 4 m."""
    cells = np.zeros((80, 100), np.float32)
    cells[10:71, 10:91] = -3.0
    cells[[10, 70], 10:91] = cells[10:71, [10, 90]] = 3.0
    cells[10:50, 40] = 3.0
    if door:
        cells[20:40, 40] = -3.0
    return wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62)


def judged(a: WallMap, b: WallMap, poses: np.ndarray) -> Agreements:
    return judge_poses(surface_of(a, outline_of(a)), probe_of(outline_of(b), 3000), poses, CELL_M)


def test_a_map_agrees_with_itself():
    walls = room()
    length = outline_of(walls).lengths.sum()
    found = judged(walls, walls, HERE)
    assert found.known[0] == pytest.approx(length, rel=1e-3)
    assert found.hits[0] == pytest.approx([length] * 3, rel=1e-3)
    assert found.conflicts[0].tolist() == [0.0] * 3
    assert found.crossing[0] == 0.0
    assert found.bad[0] == found.bad_lines[0] == 0.0
    assert found.hit_gap[0] == 0.0
    assert 5 <= found.good_lines[0] <= 9  # four sides and the wall across, which may fall into two bins


def test_walls_in_free_space_contradict_and_crossing_ones_do_not_agree():
    walls = room()
    turned = se2.compose(np.array([2.5, 2.0, np.pi / 2]), np.array([-2.5, -2.0, 0.0]))
    found = judged(walls, walls, turned[np.newaxis])
    assert found.conflicts[0, 1] > 1.0
    assert found.worst[0, 0] > 0.5
    assert found.crossing[0] > 0.0
    assert found.bad_lines[0] >= 1.0
    assert found.hits[0, 1] < 0.6 * found.known[0]


def test_a_missing_wall_contradicts_by_its_length():
    found = judged(room(door=True), room(), HERE)
    assert found.conflicts[0, 0] == pytest.approx(1.0 - 0.6, abs=0.15)  # a thin wall once, less 0.3 m at each end
    assert found.conflicts[0, 2] == 0.0


def test_a_corridor_holds_across_and_not_along():
    cells = np.zeros((60, 200), np.float32)
    cells[20:46] = -3.0
    cells[[20, 46]] = 3.0
    walls = wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62)
    found = judged(walls, walls, HERE)
    assert found.weak[0] < 0.02 * found.strong[0]
    assert abs(np.sin(found.weak_direction[0])) < 0.05
    assert found.variety[0] == pytest.approx(2.0, abs=0.1)


def one_side(above: bool) -> WallMap:
    """A straight wall of 8 m and one cell, seen from one side only."""
    cells = np.zeros((120, 200), np.float32)
    cells[60, 20:180] = 3.0
    cells[slice(61, 100) if above else slice(20, 60), 20:180] = -3.0
    return wall_map(OccupancyGrid(cells, CELL_M, np.zeros(3)), free_below=-0.62)


def test_walls_seen_from_opposite_sides_are_told_from_those_seen_from_one():
    same = judged(one_side(above=True), one_side(above=True), HERE)
    opposite = judged(one_side(above=True), one_side(above=False), HERE)
    assert same.before[0] == pytest.approx(8.0, rel=0.05)
    assert same.behind[0] == 0.0
    assert opposite.behind[0] == pytest.approx(8.0, rel=0.05)
    assert opposite.before[0] == 0.0
    turned = np.array([[0.0, 0.0, np.pi]])
    turned[0, :2] = np.array([10.0, 6.05])  # about the wall's middle
    assert judged(one_side(above=True), one_side(above=True), turned).behind[0] == pytest.approx(8.0, rel=0.05)


def test_many_poses_are_judged_as_each_by_itself():
    walls, other = room(), room(door=True)
    poses = np.random.default_rng(3).uniform([-1.0, -1.0, -0.5], [1.0, 1.0, 0.5], (20, 3))
    together = judged(walls, other, poses)
    net = net_metres(surface_of(walls, outline_of(walls)), probe_of(outline_of(other), 3000), poses, CELL_M)
    for k, pose in enumerate(poses):
        alone = judged(walls, other, pose[np.newaxis])
        for name in Agreements.__dataclass_fields__:
            assert getattr(together, name)[k] == pytest.approx(getattr(alone, name)[0], rel=1e-5, abs=1e-5), name
        assert net[k] == pytest.approx(alone.hits[0] - 2.0 * alone.conflicts[0], abs=1e-4)


def test_a_thinned_probe_stands_for_all_of_the_wall():
    outline = outline_of(room())
    thinned = probe_of(outline, 100)
    assert len(thinned.points) == 100
    assert thinned.lengths.sum() == pytest.approx(outline.lengths.sum())


def test_limits_grow_with_coarse_cells():
    fine, coarse = limits_m(0.05), limits_m(0.2)
    assert fine[0].tolist() == [0.12, 0.25, 0.5]
    assert coarse[0] == pytest.approx([0.3, 0.3, 0.5])
    assert coarse[1] == pytest.approx([0.6, 0.6, 1.2])


def test_cells_are_compared_by_area():
    walls = room()
    rows, cols = np.nonzero(walls.states != 0)
    cells = np.asarray((np.column_stack([cols, rows]) + 0.5) * CELL_M, dtype=np.float64)
    own = walls.states[rows, cols]
    free, wall, one_each = compare_cells(surface_of(walls, outline_of(walls)), cells, own, CELL_M**2, HERE)
    assert free[0] == pytest.approx(np.count_nonzero(own == FREE) * CELL_M**2)
    assert wall[0] == pytest.approx(np.count_nonzero(own == WALL) * CELL_M**2)
    assert one_each[0] == 0.0


def test_points_are_placed_by_poses():
    poses = np.random.default_rng(2).normal(size=(4, 3))
    points = np.random.default_rng(3).normal(size=(6, 2))
    for placed, pose in zip(place(points, poses), poses, strict=True):
        assert placed == pytest.approx(se2.transform_points(pose, points))
