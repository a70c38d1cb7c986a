"""Wrong pairs of different buildings: never of one, never twice, and of all buildings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tools.other_buildings import FIRST, BuildingMap, varied_pairs

MAPS = [
    BuildingMap(building, Path(f"{building}-{number}.yaml"), kind, resolution_m)
    for building in ("hall", "house", "shop")
    for number, (kind, resolution_m) in enumerate(
        [(FIRST, 0.05), ("camera", 0.05), ("resolution", 0.1), ("warped", 0.04)]
    )
]


def drawn(count, seed=0, taken=None):
    return list(varied_pairs(MAPS, MAPS, count, np.random.default_rng(seed), set() if taken is None else taken))


def test_a_building_is_never_paired_with_itself():
    assert all(pair.building_a != pair.building_b and pair.truth is None for pair in drawn(40))


def test_no_pair_comes_twice_nor_one_that_is_taken():
    taken: set[frozenset[Path]] = set()
    pairs = drawn(20, 0, taken) + drawn(20, 1, taken)
    assert len({frozenset((pair.a, pair.b)) for pair in pairs}) == len(pairs)


def test_it_ends_when_there_are_no_more():
    assert len(drawn(1000)) <= 3 * 16
    assert list(varied_pairs(MAPS[:4], MAPS[:4], 5, np.random.default_rng(0), set())) == []


def test_all_buildings_take_turns():
    pairs = drawn(6)
    assert len({(pair.building_a, pair.building_b) for pair in pairs}) == 6


def test_the_kind_is_that_of_the_harder_map():
    kinds = {each.path: each.kind for each in MAPS}
    for pair in drawn(40):
        of_both = {kinds[pair.a], kinds[pair.b]}
        if "warped" in of_both:
            assert pair.kind == "warped"
        elif "camera" in of_both:
            assert pair.kind == "camera"
        else:
            assert pair.kind == ("resolution" if of_both == {FIRST, "resolution"} else "lidar")
