"""What makes two maps one."""

from __future__ import annotations

import numpy as np

from fusion.identity import content_hash, precedes, reference_rank, same_evidence
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
