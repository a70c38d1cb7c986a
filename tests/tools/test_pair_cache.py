"""What was finished is found again, exactly, and a line that a kill cut off is not."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.alignment import Alignment, Alternative
from mapping.grid import OccupancyGrid
from tools.errors import ToolError
from tools.pair_cache import FinishedPair, PairCache, exact_hash

FULL = Alignment(
    np.array([0.1, -2.0 / 3.0, np.pi / 3.0]),
    False,
    "ambiguous: another place",
    inliers=7,
    acceptance=0.97,
    overlap=1.0 / 3.0,
    probability=0.91,
    covariance=np.array([[0.01, 0.001, 0.0], [0.001, 0.02, 0.0], [0.0, 0.0, 1e-7]]),
    alternatives=(Alternative(np.array([1.0, 2.0, 3.0]), 0.3),),
    scale=1.25,
    ambiguous=True,
    common_wall_m=12.5,
    conflict_m=0.5,
    slide=(0.5, 2.0),
)
EMPTY = Alignment(None, False, "no wall")


def assert_same(one: Alignment, other: Alignment) -> None:
    for name in Alignment.__slots__:
        a, b = getattr(one, name), getattr(other, name)
        if name == "alternatives":
            assert len(a) == len(b)
            for each, its in zip(a, b, strict=True):
                np.testing.assert_array_equal(each.T_a_b, its.T_a_b)
                assert each.probability == its.probability
        else:
            np.testing.assert_array_equal(a, b)


def test_what_was_added_is_read_back_exactly(tmp_path):
    cache = PairCache(tmp_path / "pairs.jsonl", "default")
    cache.add("one", FinishedPair(FULL, 1.25))
    cache.add("two", FinishedPair(EMPTY, 0.5))
    again = PairCache(tmp_path / "pairs.jsonl", "default")
    for key, alignment, seconds in (("one", FULL, 1.25), ("two", EMPTY, 0.5)):
        found = again.get(key)
        assert found is not None
        assert found.seconds == seconds
        assert_same(found.alignment, alignment)
    assert again.get("three") is None


def test_a_run_killed_while_it_writes_loses_that_pair_only(tmp_path):
    path = tmp_path / "pairs.jsonl"
    cache = PairCache(path, "default")
    cache.add("one", FinishedPair(EMPTY, 1.0))
    cache.add("two", FinishedPair(FULL, 2.0))
    whole = path.read_bytes()
    for length in range(whole.index(b"\n") + 1, len(whole) - 1, 7):
        path.write_bytes(whole[:length])
        resumed = PairCache(path, "default")
        assert resumed.get("one") is not None
        assert resumed.get("two") is None
        resumed.add("three", FinishedPair(FULL, 3.0))
        again = PairCache(path, "default")
        assert again.get("one") is not None
        assert again.get("three") is not None


def test_another_registration_and_another_map_have_other_keys():
    cells = np.full((4, 4), -1.0, np.float32)
    grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    changed = cells.copy()
    changed[0, 0] = -1.0000001
    others = [
        OccupancyGrid(changed, 0.05, np.zeros(3)),
        OccupancyGrid(cells, 0.0500001, np.zeros(3)),
        OccupancyGrid(cells, 0.05, np.array([0.0, 0.0, 1e-9])),
        OccupancyGrid(cells.reshape(2, 8), 0.05, np.zeros(3)),
    ]
    hashes = {exact_hash(each) for each in (grid, *others)}
    assert len(hashes) == 5
    assert exact_hash(OccupancyGrid(cells, 0.05, np.zeros(3))) == exact_hash(grid)
    assert PairCache(None, "seed 0").key("a", "b") != PairCache(None, "seed 1").key("a", "b")
    assert PairCache(None, "seed 0").key("a", "b") != PairCache(None, "seed 0").key("b", "a")


def test_a_file_that_cannot_be_written_is_one_line(tmp_path):
    cache = PairCache(tmp_path / "none" / "pairs.jsonl", "default")
    with pytest.raises(ToolError, match="cannot write results"):
        cache.add("one", FinishedPair(EMPTY, 1.0))
