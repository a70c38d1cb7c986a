"""Bayes fusion with a given transform."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.certainty import CertaintyGrid, Contribution, fuse
from mapping import se2
from mapping.grid import LOG_ODDS_CLAMP, OccupancyGrid

POSE = np.array([2.0, -1.0, 0.8])


def probability(log_odds: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-log_odds.astype(np.float64)))


def pair(a: OccupancyGrid, b: OccupancyGrid, T_a_b: np.ndarray) -> CertaintyGrid:
    return fuse({"a": Contribution(a, se2.IDENTITY), "b": Contribution(b, T_a_b)})


def cells_of(*log_odds: float) -> OccupancyGrid:
    return OccupancyGrid(np.array([log_odds], np.float32), 0.05, np.zeros(3))


@given(st.floats(-3.4, 3.4), st.floats(-3.4, 3.4))
def test_the_sum_of_log_odds_is_equation_3_16(a, b):
    p, q = probability(np.array(a)), probability(np.array(b))
    expected = p * q / (p * q + (1 - p) * (1 - q))
    # A second cell keeps the two from being one map, and the sum from being an unknown rim.
    fused = pair(cells_of(a, 1.0), cells_of(b, 2.0), se2.IDENTITY).grid()
    assert fused.log_odds[0, -1] == 3.0
    found = fused.log_odds[0, 0] if fused.log_odds.shape[1] == 2 else 0.0
    assert probability(np.array(found)) == pytest.approx(expected, abs=1e-6)


def test_unknown_changes_nothing_and_the_clamp_holds():
    a = cells_of(-3.0, 0.0, LOG_ODDS_CLAMP)
    fused = pair(a, cells_of(0.0, 1.0, 0.0), se2.IDENTITY).grid()
    np.testing.assert_array_equal(fused.log_odds, [[-3.0, 1.0, LOG_ODDS_CLAMP]])
    twice = pair(a, cells_of(-3.0, 1.0, LOG_ODDS_CLAMP), se2.IDENTITY).grid()
    np.testing.assert_array_equal(twice.log_odds, [[-6.0, 1.0, LOG_ODDS_CLAMP]])


def test_a_map_alone_is_the_map(view):
    a = view(0.0, 12.0, np.zeros(3), 1)
    fused = fuse({"a": Contribution(a, se2.IDENTITY)}).grid()
    rows, cols = np.nonzero(a.known)
    found = fused.cell_coordinates(a.cell_centers(rows, cols)).astype(int)
    np.testing.assert_array_equal(fused.log_odds[found[:, 1], found[:, 0]], a.log_odds[rows, cols])
    assert np.count_nonzero(fused.known) == len(rows)


def test_the_finer_resolution_is_that_of_the_result(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1, 0.05), view(8.0, 30.0, POSE, 2, 0.04)
    assert pair(a, b, se2.inverse(POSE)).grid().resolution_m == 0.04


def test_a_map_fused_with_itself_counts_once(view):
    a = view(0.0, 16.0, np.zeros(3), 1)
    fused = pair(a, a, se2.IDENTITY)
    assert fused.within
    grid = fused.grid()
    np.testing.assert_array_equal(grid.log_odds[grid.known], a.log_odds[a.known])


def test_two_runs_over_one_place_count_twice(view):
    a, b = view(0.0, 16.0, np.zeros(3), 1), view(0.0, 16.0, np.zeros(3), 2)
    fused = pair(a, b, se2.IDENTITY)
    assert not fused.within
    assert np.abs(fused.grid().log_odds).max() > np.abs(a.log_odds).max()


@pytest.fixture
def many(view):
    """Five maps of one floor in frames of their own, two of them coarser, at the poses that are true."""
    maps = {}
    for number, (low, high, resolution_m) in enumerate([(0, 14, 0.05), (8, 22, 0.1), (0, 30, 0.08), (15, 30, 0.05)]):
        frame = np.array([number * 1.3, -number * 2.1, 0.7 * number])
        maps[f"m{number}"] = Contribution(view(low, high, frame, number + 1, resolution_m), se2.inverse(frame))
    maps["fine"] = Contribution(view(5.0, 12.0, np.array([0.4, 0.2, -1.1]), 9, 0.04), se2.inverse([0.4, 0.2, -1.1]))
    return maps


def same(one, other):
    a, b = one.grid(), other.grid()
    np.testing.assert_array_equal(a.log_odds, b.log_odds)
    np.testing.assert_array_equal(a.origin, b.origin)
    assert a.resolution_m == b.resolution_m


def test_twenty_orders_give_one_grid_bit_by_bit(many):
    expected = fuse(many)
    random = np.random.default_rng(1)
    for _ in range(20):
        names = [list(many)[number] for number in random.permutation(len(many))]
        same(fuse({name: many[name] for name in names}), expected)
        grown = fuse({names[0]: many[names[0]]})
        for name in names[1:]:
            grown = grown.added(name, many[name])
        same(grown, expected)


@pytest.mark.parametrize("name", ["m0", "m2", "fine"])
def test_what_was_added_is_taken_away_bit_by_bit(many, name):
    before = fuse({other: each for other, each in many.items() if other != name})
    after = before.added(name, many[name])
    assert not np.array_equal(after.grid().log_odds, before.grid().log_odds)
    same(after.removed(name), before)
    same(fuse(many).removed(name), before)


def test_many_maps_are_equation_3_17(many):
    names = ["m0", "m1", "m3"]
    fused = fuse({name: many[name] for name in names}).grid()
    rows, cols = np.nonzero(fused.known)
    centers = fused.cell_centers(rows, cols)
    product = np.ones(len(rows))
    for name in names:
        each = many[name]
        col, row = np.floor(each.grid.cell_coordinates(se2.transform_points(se2.inverse(each.T_global_map), centers))
                            + 1e-9).astype(int).T  # fmt: skip
        inside = (col >= 0) & (row >= 0) & (row < each.grid.log_odds.shape[0]) & (col < each.grid.log_odds.shape[1])
        p = np.full(len(rows), 0.5)
        p[inside] = probability(each.grid.log_odds[row[inside], col[inside]])
        product *= 1.0 / p - 1.0
    expected = np.clip(-np.log(product), -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP)
    close = np.isclose(fused.log_odds[rows, cols], expected, atol=1e-3)
    assert close.mean() > 0.999  # a centre on the edge of a cell may fall to either side


def test_no_evidence_is_invented(many):
    """Each global cell says what one cell of the map says, and unknown stays unknown."""
    one = many["m2"]
    values = fuse({"m2": one, "fine": many["fine"]}).removed("fine").grid().log_odds
    assert set(np.unique(values)) <= {0.0, *np.unique(one.grid.log_odds)}
    area_m2 = np.count_nonzero(values) * one.grid.resolution_m**2
    assert area_m2 == pytest.approx(np.count_nonzero(one.grid.known) * one.grid.resolution_m**2, rel=0.01)


def test_one_map_sent_five_times_counts_once(many):
    alone = fuse({"m1": many["m1"]})
    five = fuse({f"copy{number}": many["m1"] for number in range(5)})
    same(five, alone)
    assert len(five.within) == 4
    same(five.removed("copy0"), alone)


def test_a_later_version_stands_for_the_earlier_one(many):
    later, frame = many["m0"], many["m0"].T_global_map
    cells = later.grid.log_odds.copy()
    cells[:, 180:] = 0.0  # not yet seen
    cells[:, 150:180] *= 0.5  # seen less often
    earlier = Contribution(OccupancyGrid(cells, later.grid.resolution_m, later.grid.origin), frame)
    other = {"m3": many["m3"]}
    with_both = fuse({"then": earlier, "now": later, **other})
    assert with_both.within == {"then": "now"}
    same(with_both, fuse({"now": later, **other}))
    same(with_both.removed("now"), fuse({"then": earlier, **other}))
    same(fuse({"then": earlier, **other}).added("now", later), with_both)


def test_a_name_is_added_once_and_an_unknown_one_not_removed(many):
    one = fuse({"m1": many["m1"]})
    with pytest.raises(ValueError, match="m1: has been added already"):
        one.added("m1", many["m0"])
    with pytest.raises(KeyError):
        one.removed("m0")
    with pytest.raises(ValueError, match="no map"):
        fuse({})


def test_evidence_beyond_the_clamp_is_not_lost():
    """Three maps for, one against: the order in which a clamped sum was made would show."""
    frame = np.zeros(3)
    strong = [OccupancyGrid(np.full((2, 2), value, np.float32), 0.1, frame) for value in (6.0, 5.0, 4.0, -6.5)]
    fused = fuse({str(number): Contribution(grid, frame) for number, grid in enumerate(strong)})
    np.testing.assert_array_equal(fused.grid().log_odds, np.full((2, 2), LOG_ODDS_CLAMP))
    np.testing.assert_allclose(fused.removed("0").grid().log_odds, np.full((2, 2), 2.5))
