"""A set of maps whose pairs are registered as the truth says: groups, undo and order."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment
from fusion.map_set import MapSet, middle_of
from fusion.retrieval import RetrievalRule
from mapping import se2

COVARIANCE = np.diag([0.01, 0.01, 0.001]) ** 2
WINDOWS = {"west": (0, 12), "mid": (8, 20), "east": (16, 30), "all": (0, 30), "far": (22, 30)}


@pytest.fixture(scope="module")
def frames():
    random = np.random.default_rng(3)
    return {name: random.uniform(-3.0, 3.0, 3) for name in WINDOWS}


@pytest.fixture(scope="module")
def maps(view, frames):
    return {
        name: view(low, high, frames[name], seed, 0.05 + 0.01 * (seed % 3))
        for seed, (name, (low, high)) in enumerate(WINDOWS.items())
    }


def complete(maps: MapSet, frames) -> MapSet:
    """Register what is missing: windows that share 3 m of the building are accepted, a little off."""
    while missing := maps.missing():
        found = {}
        for a, b in missing:
            shared = min(WINDOWS[a][1], WINDOWS[b][1]) - max(WINDOWS[a][0], WINDOWS[b][0])
            off = np.array([0.01 * len(a), -0.01 * len(b), 0.001])
            T_a_b = se2.compose(se2.compose(frames[a], se2.inverse(frames[b])), off)
            found[a, b] = Alignment(T_a_b, shared >= 3, "drawn", probability=0.99, covariance=COVARIANCE)
        maps = maps.registered(found)
    return maps


def grids(maps: MapSet):
    return [maps.fused(group).grid() for group in maps.structure().groups]


def assert_same(one: MapSet, other: MapSet) -> None:
    for a, b in zip(grids(one), grids(other), strict=True):
        np.testing.assert_array_equal(a.log_odds, b.log_odds)
        np.testing.assert_array_equal(a.origin, b.origin)
    for a, b in zip(one.structure().groups, other.structure().groups, strict=True):
        assert list(a.maps) == list(b.maps)
        for name, placed in a.maps.items():
            np.testing.assert_array_equal(placed.T_group_map, b.maps[name].T_group_map)


@pytest.mark.parametrize("retrieval", [RetrievalRule(), RetrievalRule(all_pairs=2, nearest=2, between=1)])
def test_groups_and_cells_do_not_depend_on_the_order(maps, frames, retrieval):
    expected = complete(MapSet(retrieval=retrieval).added(maps), frames)
    assert len(expected.structure().groups) == 1
    random = np.random.default_rng(0)
    for _ in range(5):
        grown = MapSet(retrieval=retrieval)
        for number in random.permutation(len(maps)):
            name = list(maps)[number]
            grown = complete(grown.added({name: maps[name]}), frames)
        assert_same(grown, expected)


@pytest.mark.parametrize("retrieval", [RetrievalRule(), RetrievalRule(all_pairs=2, nearest=1, between=1)])
@pytest.mark.parametrize("name", ["all", "mid"])
def test_a_map_that_came_and_went_leaves_no_trace(maps, frames, name, retrieval):
    others = {other: grid for other, grid in maps.items() if other != name}
    before = complete(MapSet(retrieval=retrieval).added(others), frames)
    after = complete(before.added({name: maps[name]}), frames)
    assert name in after.structure().groups[0].maps
    assert_same(complete(after.removed(name), frames), before)
    assert not after.removed(name).added({name: maps[name]}).missing()  # nothing is registered twice


def test_poses_are_those_of_the_truth_and_groups_stay_apart(maps, frames):
    set_of = complete(MapSet().added({name: maps[name] for name in ("west", "mid", "far")}), frames)
    groups = set_of.structure().groups
    assert sorted(sorted(group.maps) for group in groups) == [["far"], ["mid", "west"]]
    two = next(group for group in groups if "mid" in group.maps)
    found = se2.between(two.maps["west"].T_group_map, two.maps["mid"].T_group_map)
    np.testing.assert_allclose(found, se2.compose(frames["west"], se2.inverse(frames["mid"])), atol=0.2)


def test_names_are_checked(maps):
    one = MapSet().added({"west": maps["west"]})
    with pytest.raises(ValueError, match="west: is in the set already"):
        one.added({"west": maps["mid"]})
    with pytest.raises(KeyError):
        one.removed("mid")


def test_the_middle_is_that_of_the_known_cells(view):
    np.testing.assert_allclose(middle_of(view(0.0, 12.0, np.zeros(3), 1)), [6.0, 9.0], atol=0.1)


def test_a_forgetful_set_knows_nothing_of_maps_that_left_and_says_the_same(maps, frames):
    retrieval = RetrievalRule(all_pairs=2, nearest=2, between=1)
    full = complete(MapSet(retrieval=retrieval).added(maps), frames).removed("all")
    lean = full.forgetful()
    assert_same(complete(lean, frames), complete(full, frames))
    for known in (lean.alignments, lean.alike):
        assert known
        assert not any("all" in pair for pair in known)
    assert set(lean.signatures) == set(maps) - {"all"}
