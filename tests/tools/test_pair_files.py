"""Pair lists: what is written is read, and what is not whole is one clear line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.errors import ToolError
from tools.pair_files import LIST_NAME, MapPair, PairTruth, joined_pairs, load_grids, read_pairs, write_pairs

RANDOM = np.random.default_rng(3)
POINTS = RANDOM.uniform(-50.0, 50.0, (7, 2))
TRUTH = PairTruth(np.array([1.25, -3.5, 2.0]), POINTS, POINTS + 1.0, 0.75, 5.0)


def listed(folder):
    a, b = folder / "maps/a.yaml", folder / "maps/b.yaml"
    return [
        MapPair("true", a, b, "hall", "hall", "camera", "mid", 0.5, 12.25, TRUTH),
        MapPair("same building", a, b, "hall", "hall", "lidar"),
        MapPair("other building", b, a, "hall", "house", "warped"),
    ]


def test_a_list_comes_back_as_it_was(tmp_path):
    write_pairs(tmp_path, listed(tmp_path), "a test")
    for before, after in zip(listed(tmp_path), read_pairs(tmp_path), strict=True):
        for name in ("name", "a", "b", "building_a", "building_b", "kind", "band", "overlap", "common_wall_m"):
            assert getattr(after, name) == getattr(before, name)
        assert (after.truth is None) == (before.truth is None)
    truth = read_pairs(tmp_path)[0].truth
    assert truth is not None
    assert (truth.T_a_b == TRUTH.T_a_b).all()
    assert np.abs(truth.points_a - TRUTH.points_a).max() < 1e-4
    assert (truth.right_m, truth.right_deg) == (0.75, 5.0)


def test_a_list_goes_with_its_folder(tmp_path):
    first = tmp_path / "first"
    (first / "maps").mkdir(parents=True)
    grid = OccupancyGrid(np.array([[-3.0, 3.0]], np.float32), 0.05, np.zeros(3))
    write_map(first / "maps/a", grid)
    write_map(first / "maps/b", grid)
    write_pairs(first, listed(first), "a test")
    moved = first.rename(tmp_path / "second")
    for loaded in load_grids(read_pairs(moved)[0]):
        assert (np.sign(loaded.log_odds) == np.sign(grid.log_odds)).all()


def test_lists_are_joined_and_no_name_is_lost(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    for folder, pairs in ((one, listed(one)), (two, listed(two)[:2])):
        folder.mkdir()
        write_pairs(folder, pairs, "a test")
    joined = joined_pairs([one, two])
    assert [pair.name for pair in joined] == [
        "one-true",
        "one-same building",
        "other building",
        "two-true",
        "two-same building",
    ]
    assert [pair.a.parent.parent.name for pair in joined] == ["one"] * 3 + ["two"] * 2
    write_pairs(tmp_path, joined, "a test")
    assert [pair.a.resolve() for pair in read_pairs(tmp_path)] == [pair.a.resolve() for pair in joined]
    with pytest.raises(ToolError, match="the name of two pairs"):
        joined_pairs([one, one])


def spoilt(tmp_path, change):
    write_pairs(tmp_path, listed(tmp_path), "a test")
    content = json.loads((tmp_path / LIST_NAME).read_text())
    change(content)
    (tmp_path / LIST_NAME).write_text(json.dumps(content))
    return tmp_path


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda list_: list_.update(format="other"), "not a pair list"),
        (lambda list_: list_.update(version=2), "version 1"),
        (lambda list_: list_.update(pairs=[]), "no pairs"),
        (lambda list_: list_["pairs"][1].pop("a"), "pair 1"),
        (lambda list_: list_["pairs"][2].update(kind="sonar"), "sonar"),
        (lambda list_: list_["pairs"][0].update(band="huge"), "huge"),
        (lambda list_: list_["pairs"][0].update(common_wall_m="long"), "long"),
        (lambda list_: list_["pairs"][0]["truth"].update(T_a_b=[1.0, 2.0]), "expected (3,)"),
        (lambda list_: list_["pairs"][0]["truth"]["points_a"].pop(), "pair 0"),
        (lambda list_: list_["pairs"][0]["truth"].update(right_m=float("nan")), "not finite"),
    ],
)
def test_what_is_not_whole_is_one_line(tmp_path, change, says):
    with pytest.raises(ToolError) as raised:
        read_pairs(spoilt(tmp_path, change))
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)


def test_no_list_and_no_json_are_told(tmp_path):
    with pytest.raises(ToolError, match="mapfuse-robot pairs"):
        read_pairs(tmp_path)
    (tmp_path / LIST_NAME).write_text("{")
    with pytest.raises(ToolError, match="not JSON"):
        read_pairs(tmp_path)
