"""Pools of hypotheses: the true place is among them and the only one that is right; a cache gives the same pools."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.evidence import TRENDS
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.errors import ToolError
from tools.hypothesis_pools import HypothesisPool, keyed_pairs, pool_of, pools_of, read_pools, write_pools
from tools.pair_files import MapPair, PairTruth, read_pairs, write_pairs
from tools.pair_making import WindowPlan, window_pairs, write_scale_map


@pytest.fixture(scope="module")
def listed(corridor_drive, tmp_path_factory):
    """A true pair of one place, and a wrong one of two."""
    folder = tmp_path_factory.mktemp("pairs")
    made = window_pairs(folder, corridor_drive, WindowPlan(1, 1, ("lidar",), 60), 0)
    chosen = [next(pair for pair in made if pair.band == "high"), next(pair for pair in made if pair.truth is None)]
    write_pairs(folder, chosen, "a test")
    return folder


@pytest.fixture(scope="module")
def pools(listed, tmp_path_factory):
    cache = tmp_path_factory.mktemp("cache") / "pools.npz"
    return pools_of(keyed_pairs(listed), 0, 1, cache, lambda _: None), cache


def equal(one: HypothesisPool, two: HypothesisPool) -> bool:
    """Tell whether two pools are one."""
    arrays = ("features", "right", "different")
    same = all(np.array_equal(getattr(one, name), getattr(two, name)) for name in arrays)
    return same and (one.key, one.buildings, one.true) == (two.key, two.buildings, two.true)


def test_of_a_true_pair_some_are_right_and_of_a_wrong_one_none(pools):
    true, wrong = pools[0]
    assert 0 < np.count_nonzero(true.right) < len(true.right)
    assert not wrong.right.any()
    assert (true.true, wrong.true) == (True, False)
    assert true.features.shape == (len(true.right), len(TRENDS))
    best = int(np.argmax(true.features[:, list(TRENDS).index("net_middle")]))
    assert true.right[best]
    assert not true.different[np.ix_(true.right, true.right)].any()


def test_the_order_of_a_pair_does_not_change_its_pool(listed, pools):
    """The registration exchanges the maps by their content; the truth has to follow."""
    pair = read_pairs(listed)[0]
    assert pair.truth is not None
    truth = PairTruth(se2.inverse(pair.truth.T_a_b), pair.truth.points_b, pair.truth.points_a)
    exchanged = pool_of("x", replace(pair, a=pair.b, b=pair.a, truth=truth), 0)
    differing = [
        name
        for name, one, two in zip(TRENDS, exchanged.features.T, pools[0][0].features.T, strict=True)
        if (one != two).any()
    ]
    assert differing == []
    assert np.array_equal(exchanged.right, pools[0][0].right)


def test_the_cache_gives_the_same_pools_without_the_maps(listed, pools):
    made, cache = pools
    keyed = keyed_pairs(listed)
    gone = {key: replace(pair, a=listed / "gone.yaml", b=listed / "gone.yaml") for key, pair in keyed.items()}
    told: list[str] = []
    again = pools_of(gone, 0, 1, cache, told.append)
    assert all(map(equal, made, again))
    assert told == ["2 pairs, 2 of them in the cache"]
    assert [pool.key for pool in pools_of(dict(reversed(gone.items())), 0, 1, cache, told.append)] == [*gone][::-1]


def test_maps_that_cannot_be_aligned_have_an_empty_pool_that_the_cache_keeps(tmp_path):
    unknown = OccupancyGrid(np.full((20, 20), 3.0, np.float32), 0.05, np.zeros(3))
    path = write_scale_map(tmp_path / "wall", unknown)
    pool = pool_of("x", MapPair("x", path, path, "hall", "house", "lidar"), 0)
    assert (len(pool.right), pool.different.shape) == (0, (0, 0))
    write_pools(tmp_path / "cache.npz", [pool, replace(pool, key="y")], 0)
    assert all(equal(replace(pool, key=key), found) for key, found in read_pools(tmp_path / "cache.npz", 0).items())


def test_a_cache_of_something_else_is_told(pools, tmp_path):
    made, cache = pools
    with pytest.raises(ToolError, match="of seed 0 instead of 1"):
        read_pools(cache, 1)
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(ToolError, match="no cache of pools"):
        read_pools(tmp_path / "text.npz", 0)
    with pytest.raises(ToolError, match="cannot write"):
        write_pools(tmp_path / "none/cache.npz", made, 0)


def test_a_list_made_anew_has_other_keys(listed, tmp_path):
    one = [*keyed_pairs(listed)]
    write_pairs(tmp_path, read_pairs(listed)[:1], "a test")
    two = [*keyed_pairs(tmp_path)]
    assert not set(one) & set(two)
    assert len(one) == len(set(one)) == 2
    write_pairs(tmp_path, read_pairs(listed)[:1] * 2, "a test")
    with pytest.raises(ToolError, match="two pairs of the list have one name"):
        keyed_pairs(tmp_path)
