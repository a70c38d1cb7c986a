"""Pairs are registered once, whoever asks and however often a run is interrupted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.algorithm3 import THESIS
from fusion.registration import register
from mapping.grid import OccupancyGrid
from tools.pair_registration import PairRegistration, Registration

DEFAULT = Registration("default", THESIS, 0)


@pytest.fixture
def maps():
    """Three maps with nothing to register by, so that a verdict is quick; the fourth names no pair."""
    cells = np.full((8, 8), 3.0, np.float32)
    return {name: OccupancyGrid(cells[:size], 0.05, np.zeros(3)) for name, size in (("a", 8), ("b", 7), ("c", 6))}


PAIRS = [("a", "b"), ("a", "c"), ("b", "c")]


@pytest.mark.parametrize("jobs", [1, 2])
def test_each_pair_is_registered_and_kept_at_once(maps, tmp_path, jobs):
    done = []
    pairs = PairRegistration(
        DEFAULT, tmp_path / "pairs.jsonl", jobs, lambda number, count: done.append((number, count))
    )
    found = pairs.finish(maps, PAIRS)
    assert done == [(1, 3), (2, 3), (3, 3)]
    assert list(found) == PAIRS
    for (a, b), finished in found.items():
        assert finished.alignment.reason == register(maps[a], maps[b]).reason
    assert (pairs.registered, pairs.taken) == (3, 0)
    assert len((tmp_path / "pairs.jsonl").read_text().splitlines()) == 3


def test_an_interrupted_run_goes_on(maps, tmp_path):
    def interrupt(done, _count):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        PairRegistration(DEFAULT, tmp_path / "pairs.jsonl", 1, interrupt).finish(maps, PAIRS)
    resumed = PairRegistration(DEFAULT, tmp_path / "pairs.jsonl", 1, lambda *_: None)
    assert list(resumed.finish(maps, PAIRS)) == PAIRS
    assert (resumed.registered, resumed.taken) == (1, 2)
    resumed.finish(maps, PAIRS)
    assert resumed.registered == 1


def test_what_a_result_depends_on_makes_it_another_one(maps, tmp_path):
    path = tmp_path / "pairs.jsonl"
    PairRegistration(DEFAULT, path, 1, lambda *_: None).finish(maps, PAIRS[:1])
    for other in (
        replace(DEFAULT, seed=1),
        replace(DEFAULT, method="thesis"),
        Registration("thesis", replace(THESIS, alpha=0.5), 0),
    ):
        pairs = PairRegistration(other, path, 1, lambda *_: None)
        pairs.finish(maps, PAIRS[:1])
        assert pairs.registered == 1
