"""Cheap retrieval: resemblance does not depend on frames, and no building is left in pieces for want of a pair."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fusion.retrieval import MapsTogether, RetrievalRule, chosen_pairs, resemblance, signature
from mapping.grid import OccupancyGrid


def test_maps_of_one_place_resemble_each_other_in_any_frame_and_resolution(view):
    here = signature(view(0.0, 16.0, np.zeros(3), 1))
    turned = signature(view(6.0, 24.0, np.array([3.0, 1.0, 2.2]), 2))
    coarser = signature(view(6.0, 24.0, np.array([-3.0, 1.0, -0.9]), 3, 0.08))
    mirrored = view(0.0, 16.0, np.zeros(3), 1)
    elsewhere = signature(OccupancyGrid(mirrored.log_odds[:, ::-1], mirrored.resolution_m, mirrored.origin))
    for other in (turned, coarser):
        assert resemblance(here, other) > 6.0
    assert resemblance(here, elsewhere) < resemblance(here, turned)


def test_a_map_without_texture_resembles_nothing(view):
    blank = signature(OccupancyGrid(np.full((40, 40), -3.0, np.float32), 0.05, np.zeros(3)))
    nothing = signature(OccupancyGrid(np.zeros((40, 40), np.float32), 0.05, np.zeros(3)))
    here = signature(view(0.0, 16.0, np.zeros(3), 1))
    assert resemblance(nothing, here) == 0.0
    assert resemblance(here, nothing) == 0.0
    assert resemblance(here, blank) < 3.0


def registered_to_the_end(keys, alike, truly, rule):
    """Register chosen pairs, of which those in `truly` are accepted, until no more are wanted; return them."""
    verdicts: dict[tuple[str, str], bool] = {}

    def grouped(accepted):
        root = {key: key for key in keys}
        for a, b in accepted:
            root = {key: root[a] if each == root[b] else each for key, each in root.items()}
        for first in sorted(set(root.values())):
            members = [key for key in keys if root[key] == first]
            yield MapsTogether(members, [pair for pair in itertools.combinations(members, 2) if pair in truly])

    while True:
        chosen = chosen_pairs(keys, alike, verdicts, grouped, rule)
        missing = [pair for pair in chosen if pair not in verdicts]
        if not missing:
            return chosen
        verdicts.update({pair: pair in truly for pair in missing})


def test_of_a_few_maps_all_pairs_are_registered():
    keys = [f"m{number}" for number in range(8)]
    assert len(registered_to_the_end(keys, {}, set(), RetrievalRule())) == 28


@pytest.mark.parametrize("missed", [0.0, 0.3])
def test_buildings_connect_with_fewer_registrations_than_all_pairs(missed):
    """Four buildings of five maps; some pairs of a building do not look alike at all, some of two buildings do."""
    random = np.random.default_rng(5)
    keys = [f"b{number % 4}m{number}" for number in range(20)]
    alike, truly = {}, set()
    for a, b in itertools.combinations(keys, 2):
        same = a[:2] == b[:2]
        if same:
            truly.add((a, b))
        seen = same and random.random() >= missed
        alike[a, b] = random.uniform(4.0, 20.0) if seen else random.uniform(0.0, 3.1)
    chosen = registered_to_the_end(keys, alike, truly, RetrievalRule())
    assert truly <= set(chosen)
    assert len(chosen) < 130


def test_maps_that_resemble_nothing_are_tried_with_many():
    keys = [f"m{number:02d}" for number in range(12)]
    alike = dict.fromkeys(itertools.combinations(keys, 2), 2.1)
    truly = {("m00", "m11")}
    assert truly <= set(registered_to_the_end(keys, alike, truly, RetrievalRule()))


def test_what_else_was_registered_does_not_count():
    keys = [f"m{number:02d}" for number in range(12)]
    random = np.random.default_rng(1)
    alike = {pair: random.uniform(0.0, 5.0) for pair in itertools.combinations(keys, 2)}
    rule = RetrievalRule(nearest=2, between=0)

    def nothing(accepted):
        return [MapsTogether([key], []) for key in keys]

    first = chosen_pairs(keys, alike, {}, nothing, rule)
    more = dict.fromkeys(alike, False)
    assert chosen_pairs(keys, alike, more, nothing, rule) == first
    assert len(first) < len(alike)
