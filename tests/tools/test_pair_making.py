"""Pairs of maps in files: the truth is true for each kind, and the files hold what was drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map
from mapping.map_yaml import read_map_yaml
from tools.pair_files import load_grids
from tools.pair_making import WindowPlan, copy_map, window_pairs, write_scale_map
from tools.pair_overlap import common_free, common_wall_m, wall_line

PLAN = WindowPlan(2, 1, ("lidar", "resolution", "camera", "bent"), tries=120)


@pytest.fixture(scope="module")
def made(corridor_drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    return folder, window_pairs(folder, corridor_drive, PLAN, 0)


def test_there_are_true_and_wrong_pairs_of_every_kind(made):
    _, pairs = made
    assert {(pair.kind, pair.truth is not None) for pair in pairs} == {
        (kind, true) for kind in PLAN.kinds for true in (True, False)
    }


def test_at_the_true_pose_the_files_agree_as_the_list_says(made):
    for pair in made[1]:
        if pair.truth is None:
            assert pair.band is None
            continue
        a, b = load_grids(pair)
        assert common_free(a, b, pair.truth.T_a_b).share == pytest.approx(pair.overlap, abs=0.01)
        shared_m = common_wall_m(wall_line(a), wall_line(b), pair.truth.T_a_b)
        assert shared_m == pytest.approx(pair.common_wall_m, rel=0.05, abs=0.2)


def test_no_other_pose_nearby_shares_as_much_wall(made):
    for pair in made[1]:
        if pair.truth is None or pair.kind in {"camera", "bent"}:
            continue
        lines = [wall_line(grid) for grid in load_grids(pair)]
        at_truth = common_wall_m(lines[0], lines[1], pair.truth.T_a_b, 0.1)
        for off in ([0.0, 0.6, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, np.pi]):
            assert common_wall_m(lines[0], lines[1], se2.compose(pair.truth.T_a_b, off), 0.1) < at_truth


def test_the_points_of_the_truth_lie_in_free_space_of_both(made):
    for pair in made[1]:
        if pair.truth is None:
            continue
        for grid, points in zip(load_grids(pair), (pair.truth.points_a, pair.truth.points_b), strict=True):
            cols, rows = np.floor(grid.cell_coordinates(points)).astype(int).T
            cells = grid.log_odds[rows, cols]
            if pair.kind == "bent":  # walls are moved with the points, but beams pass them elsewhere
                assert (cells > 0.6).mean() < 0.2
            else:
                assert (cells < -0.6).mean() > 0.95
        apart = np.hypot(*(se2.transform_points(pair.truth.T_a_b, pair.truth.points_b) - pair.truth.points_a).T)
        assert np.sqrt((apart**2).mean()) == pytest.approx(pair.truth.right_m - 0.5, abs=1e-6)
        assert (apart.max() > 0.01) == (pair.kind == "bent")


def test_the_kinds_have_their_resolutions_and_frames(made):
    for pair in made[1]:
        resolutions = [read_map_yaml(path).resolution_m for path in (pair.a, pair.b)]
        if pair.kind == "bent":
            assert set(resolutions) <= {0.04, 0.05, 0.1}
        else:
            assert resolutions == {"resolution": [0.04, 0.1]}.get(pair.kind, [0.05, 0.05])
    turns = {round(float(pair.truth.T_a_b[2]), 6) for pair in made[1] if pair.truth is not None}
    assert len(turns) == sum(pair.truth is not None for pair in made[1])


def test_same_seed_same_bytes_and_another_seed_other_frames(made, corridor_drive, tmp_path):
    _, pairs = made
    plan = replace(PLAN, kinds=("camera", "bent"))
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    one, two = (window_pairs(tmp_path / name, corridor_drive, plan, 7) for name in ("one", "two"))
    for first, second in zip(one, two, strict=True):
        assert first.b.with_suffix(".png").read_bytes() == second.b.with_suffix(".png").read_bytes()
    frames = [[pair.truth.T_a_b[2] for pair in each if pair.truth is not None] for each in (one, pairs)]
    assert not set(frames[0]) & set(frames[1])


def test_a_scale_map_is_read_as_it_was_to_a_hundredth(tmp_path):
    p = np.linspace(0.005, 0.995, 400).reshape(20, 20)
    cells = np.log(p / (1.0 - p)).astype(np.float32)
    cells[3] = 0.0
    grid = OccupancyGrid(cells, 0.04, np.array([-3.0, 8.0, 0.3]))
    again = read_map(write_scale_map(tmp_path / "x", grid))
    assert np.abs(again.probability - grid.probability).max() <= 0.0101
    assert (again.known == grid.known).all()
    sure = np.abs(grid.probability[:, :, np.newaxis] - np.array([0.35, 0.65])).min(axis=2) > 0.011
    for limit in (0.35, 0.65):
        assert ((again.probability < limit) == (grid.probability < limit))[sure].all()
    assert (again.resolution_m, again.origin.tolist()) == (0.04, [-3.0, 8.0, 0.3])


def test_a_copied_map_is_the_same_elsewhere(tmp_path):
    grid = OccupancyGrid(np.array([[-5.0, 5.0, 0.0]], np.float32), 0.05, np.array([1.0, 2.0, 0.0]))
    files = write_map(tmp_path / "old", grid)
    path = copy_map(tmp_path / "new", files.image, read_map_yaml(files.yaml), np.array([4.0, -1.0]))
    copied = read_map(path)
    assert (copied.log_odds == read_map(files.yaml).log_odds).all()
    assert copied.origin.tolist() == [5.0, 1.0, 0.0]
