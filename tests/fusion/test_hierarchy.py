"""Merging in levels, with registrations that the truth gives."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.certainty import Contribution, fuse
from fusion.hierarchy import best_pairs, first_level, next_level, tree_lines
from mapping import se2

WINDOWS = {"a": (0, 11), "b": (6, 17), "c": (13, 24), "d": (20, 30)}


@pytest.fixture
def frames():
    random = np.random.default_rng(1)
    return {name: random.uniform(-2.0, 2.0, 3) for name in WINDOWS}


@pytest.fixture
def maps(view, frames):
    return {name: view(*WINDOWS[name], frames[name], seed) for seed, name in enumerate(WINDOWS)}


def frame_of(each, frames):
    """Where a map's frame, that of one of the original ones, is in the building."""
    return next(frames[name] for name, part in each.contributions.items() if not part.T_global_map.any())


def true_alignments(level, frames):
    """Maps that share 3 m are accepted, with an inlier for each metre that they share."""
    found = {}
    for a, b in itertools.combinations(level, 2):
        spans = [{metre for name in each.contributions for metre in range(*WINDOWS[name])} for each in (a, b)]
        shared = len(spans[0] & spans[1])
        T_a_b = se2.compose(frame_of(a, frames), se2.inverse(frame_of(b, frames)))
        found[a.name, b.name] = Alignment(T_a_b, shared >= 3, "drawn", inliers=shared, acceptance=0.9)
    return found


def to_the_top(maps, frames):
    level, sizes = first_level(maps), [len(maps)]
    while len(level) > 1:
        level = next_level(level, true_alignments(level, frames))
        sizes.append(len(level))
    return level[0], sizes


def test_four_maps_are_one_after_two_levels(maps, frames):
    top, sizes = to_the_top(maps, frames)
    assert sizes == [4, 2, 1]
    for name, part in top.contributions.items():
        true_pose = se2.compose(frame_of(top, frames), se2.inverse(frames[name]))
        np.testing.assert_allclose(part.T_global_map, true_pose, atol=1e-9)


def test_a_map_knows_in_which_level_and_by_what_it_was_merged(maps, frames):
    top, _ = to_the_top(maps, frames)
    assert top.level == 2
    assert [part.level for part in top.parts] == [1, 1]
    assert top.merged_by.inliers == 4  # b and c share 13 to 17
    assert all(part.level == 0 and part.merged_by is None for pair in top.parts for part in pair.parts)


def test_no_cell_is_looked_up_twice(maps, frames):
    top, _ = to_the_top(maps, frames)
    at_once = fuse(
        {name: Contribution(grid, top.contributions[name].T_global_map) for name, grid in maps.items()}
    ).grid()
    np.testing.assert_array_equal(top.grid.log_odds, at_once.log_odds)


def test_the_tree_names_every_map_once(maps, frames):
    top, _ = to_the_top(maps, frames)
    lines = tree_lines(top, {name: f"{name}.yaml" for name in maps})
    assert lines[0] == "4 maps"
    assert sorted(line.strip() for line in lines if "yaml" in line) == [f"{name}.yaml" for name in maps]
    assert [len(line) - len(line.lstrip()) for line in lines] == [0, 2, 4, 4, 2, 4, 4]


def test_best_pairs_have_most_inliers_and_share_no_map():
    def found(inliers, acceptance, accepted=True):
        return Alignment(np.zeros(3), accepted, "", inliers=inliers, acceptance=acceptance)

    alignments = {
        ("a", "b"): found(20, 0.95),
        ("a", "c"): found(30, 0.96),
        ("b", "d"): found(20, 0.99),
        ("c", "d"): found(90, 0.9, accepted=False),
    }
    assert best_pairs(alignments) == [("a", "c"), ("b", "d")]


def test_maps_that_share_nothing_stay(maps, frames):
    level = first_level({name: maps[name] for name in ("a", "d")})
    after = next_level(level, true_alignments(level, frames))
    assert [each.name for each in after] == [each.name for each in level]
