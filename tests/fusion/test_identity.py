"""What makes two maps one."""

from __future__ import annotations

import numpy as np

from fusion.identity import (
    content_hash,
    goes_on,
    later_version,
    may_be_later_version,
    precedes,
    reference_rank,
    same_evidence,
)
from fusion.resampling import known_corners
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map


def test_the_yaml_and_the_lossless_file_of_a_map_are_one(view, tmp_path):
    files = write_map(tmp_path / "map", view(0.0, 12.0, np.zeros(3), 1))
    assert same_evidence(read_map(files.yaml), read_map(files.lossless))


def test_neither_frame_nor_margin_counts_but_every_cell_does(view):
    a = view(0.0, 12.0, np.zeros(3), 1)
    framed = OccupancyGrid(np.pad(a.log_odds, 7), a.resolution_m, np.array([5.0, 5.0, 1.0]))
    assert content_hash(framed) == content_hash(a)
    cells = a.log_odds.copy()
    row, col = np.argwhere(a.free)[0]
    cells[row, col] = 7.0
    assert content_hash(OccupancyGrid(cells, a.resolution_m, a.origin)) != content_hash(a)


def test_two_runs_are_two_maps(view):
    assert not same_evidence(view(0.0, 12.0, np.zeros(3), 1), view(0.0, 12.0, np.zeros(3), 2))


def test_the_larger_map_is_the_reference(view):
    assert reference_rank(view(0.0, 20.0, np.zeros(3), 1)) < reference_rank(view(0.0, 12.0, np.zeros(3), 1))


def test_the_reference_does_not_depend_on_the_order_of_two_maps(view):
    large, small = view(0.0, 20.0, np.zeros(3), 1), view(0.0, 12.0, np.zeros(3), 1)
    assert precedes(large, small)
    assert not precedes(small, large)
    turned = OccupancyGrid(large.log_odds[::-1], large.resolution_m, large.origin)  # as much known area, other cells
    assert precedes(large, turned) != precedes(turned, large)
    assert precedes(large, turned) == (reference_rank(large) < reference_rank(turned))


def part_of(grid: OccupancyGrid, columns: int, origin: np.ndarray) -> OccupancyGrid:
    """The first columns of a grid, in another frame."""
    return OccupancyGrid(grid.log_odds[:, :columns], grid.resolution_m, origin)


def test_a_map_that_grew_is_a_later_version_whatever_its_frame(view):
    later = view(0.0, 16.0, np.zeros(3), 1)
    frame = np.array([3.0, -2.0, 0.5])
    earlier = part_of(later, 200, frame)
    near = np.array([0.03, -0.02, 0.002])  # as a registration would have it
    T_later_earlier = se2.compose(se2.compose(near, later.origin), se2.inverse(frame))
    assert later_version(later, earlier, T_later_earlier)
    assert not later_version(earlier, later, se2.inverse(T_later_earlier))
    assert not later_version(later, earlier, se2.compose([1.0, 0.0, 0.0], T_later_earlier))


def test_a_second_run_is_no_later_version(view):
    """Walls of another run lie half a cell off here and there, and so fall on other cells."""
    first = view(0.0, 16.0, np.zeros(3), 1)
    second = view(0.0, 20.0, np.array([0.027, 0.022, 0.0]), 2)
    assert not later_version(second, first, np.array([0.027, 0.022, 0.0]))
    assert not later_version(view(0.0, 20.0, np.zeros(3), 2, 0.04), first, se2.IDENTITY)


def test_a_map_goes_on_while_it_grows_and_bends_and_not_when_it_begins_anew(view):
    before = view(0.0, 14.0, np.zeros(3), 1)
    assert goes_on(view(0.0, 20.0, np.zeros(3), 1), before)
    assert goes_on(view(0.0, 20.0, np.array([0.2, -0.1, 0.02]), 1), before), "a loop closure moved it"
    assert not goes_on(view(0.0, 5.0, np.zeros(3), 1), before), "little is left of it"
    assert not goes_on(view(9.0, 30.0, np.zeros(3), 1), before), "another place"
    assert not goes_on(view(0.0, 20.0, np.array([0.0, 0.0, 2.0]), 1), before), "another frame"
    nothing = OccupancyGrid(np.zeros((4, 4), np.float32), 0.05, np.zeros(3))
    assert goes_on(before, nothing)


def test_whatever_is_a_later_version_may_be_one_and_most_others_are_ruled_out(view):
    earlier = view(0.0, 12.0, np.zeros(3), 1)
    corners = known_corners(earlier)
    for later, pose in ((view(0.0, 20.0, np.zeros(3), 1), np.zeros(3)), (earlier, np.array([0.05, 0.0, 0.001]))):
        assert may_be_later_version(later, earlier, pose, corners)
    far, turned = np.array([8.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])
    assert not may_be_later_version(earlier, earlier, far, corners)
    assert not may_be_later_version(earlier, earlier, turned, corners)
    coarse = view(0.0, 20.0, np.zeros(3), 1, 0.1)
    assert not may_be_later_version(coarse, earlier, np.zeros(3), corners)
