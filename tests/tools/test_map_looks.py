"""Looks that were made before are those that a set makes itself."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.map_set import MapSet
from fusion.retrieval import RetrievalRule
from tools.map_looks import with_looks

RULE = RetrievalRule(all_pairs=3)


@pytest.fixture(scope="module")
def many(rooms_part):
    return {f"map {seed}": rooms_part(seed, 10 * seed, 100 + 12 * seed) for seed in range(14)}


def test_looks_made_before_are_those_that_the_set_makes(many):
    alone = MapSet(retrieval=RULE).added(many)
    ahead = with_looks(MapSet(retrieval=RULE), many, 1)
    after = ahead.added(many)
    assert ahead.alike == alone.alike == dict(after.alike)
    assert len(ahead.alike) == 14 * 13 / 2
    assert after.pairs() == alone.pairs()
    for name, each in alone.signatures.items():
        np.testing.assert_array_equal(ahead.signatures[name].points, each.points)


def test_few_maps_need_no_looks(many):
    few = {name: many[name] for name in list(many)[:3]}
    assert not with_looks(MapSet(retrieval=RULE), few, 2).alike
