"""`bench fusion`: which pairs are drawn, what counts as right, how it is counted, and the command from end to end."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from fusion.resampling import known_corners, raster_around, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.fusion_bench import (
    METHODS,
    WALLS,
    MethodResult,
    Outcome,
    bench_method,
    is_right,
    sample_pairs,
    summarise,
)
from tools.pair_files import MapPair, PairTruth, read_pairs, write_pairs
from tools.world import office

TRUTH = np.array([8.0, -5.0, 2.0])
POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2))
SAME = PairTruth(TRUTH, se2.transform_points(TRUTH, POINTS), POINTS, 0.5, 3.0)


def made_pair(name="x", kind="lidar", band="low", truth=SAME, building_b="one", wall_m=5.0):
    return MapPair(name, Path("a"), Path("b"), "one", building_b, kind, band, 0.3, wall_m, truth)


MADE = (
    [made_pair(f"low {number}") for number in range(40)]
    + [made_pair(f"camera {number}", "camera", None) for number in range(20)]
    + [made_pair(f"wrong {number}", "lidar", None, None, "two") for number in range(40)]
)


@pytest.mark.parametrize("count", [1, 10, 50, 99])
def test_a_sample_holds_each_sort_in_its_proportion_and_order(count):
    sampled = sample_pairs(MADE, count, 0)
    names = [pair.name for pair in sampled]
    assert len(set(names)) == count
    assert names == [pair.name for pair in MADE if pair.name in set(names)]
    wrong = min(40, max(count / 4, count - 60))
    for sort, expected in (("low", (count - wrong) * 2 / 3), ("camera", (count - wrong) / 3), ("wrong", wrong)):
        assert abs(sum(name.startswith(sort) for name in names) - expected) <= 1.5


def test_a_sample_depends_on_its_seed_alone():
    names = [[pair.name for pair in sample_pairs(MADE, 30, seed)] for seed in (3, 3, 4)]
    assert names[0] == names[1] != names[2]


@pytest.mark.parametrize("pairs", [MADE, MADE[:60], MADE[60:]])
def test_a_sample_of_all_or_more_is_all(pairs):
    assert sample_pairs(pairs, 1000, 0) == pairs
    assert sample_pairs(pairs, len(pairs), 0) == pairs


@pytest.mark.parametrize(
    ("offset", "right"),
    [((0, 0, 0), True), ((0.4, 0, 0), True), ((0, 0.6, 0), False), ((0, 0, np.radians(4)), False)],
)
def test_right_is_what_the_truth_allows(offset, right):
    # A turn about the middle of the points, so that it moves them little.
    T_a_b = se2.compose(TRUTH, np.asarray(offset, dtype=np.float64))
    assert is_right(made_pair(), T_a_b) is right
    assert not is_right(made_pair(truth=None), T_a_b)
    assert not is_right(made_pair(), None)


def test_every_outcome_is_counted_once():
    outcomes = [
        Outcome(made_pair(band="low", wall_m=1.0), TRUTH, True, True, 2.0, 1.0),
        Outcome(made_pair(band="high", wall_m=8.0), TRUTH, True, False, 0.5, 2.0),
        Outcome(made_pair(kind="camera", band="low", wall_m=30.0), TRUTH, False, True, 2.0, 3.0),
        Outcome(made_pair(kind="warped", band=None, wall_m=None), None, False, False, 0.0, 4.0),
        Outcome(made_pair(band=None, truth=None), TRUTH, False, True, 2.0, 5.0),
        Outcome(made_pair(band=None, truth=None, building_b="two"), TRUTH, False, False, 2.0, 6.0),
    ]
    summary = summarise(MethodResult("thesis", tuple(outcomes), 100.0))
    counted = {name: (share["right"], share["pairs"]) for name, share in summary["aligned"].items()}
    assert {name: share for name, share in counted.items() if share[1]} == {
        "low": (1, 1), "high": (1, 1), "camera": (0, 1), "warped": (0, 1), "all": (2, 4),
    }  # fmt: skip
    assert [share["pairs"] for share in summary["aligned_by_common_wall"].values()] == [1, 0, 1, 1]
    assert list(summary["aligned_by_common_wall"]) == list(WALLS)
    assert summary["merged"] == {
        "right": 1, "wrong": 1, "of_pairs": 4,
        "false_same_building": {"merged": 1, "pairs": 1}, "false_other_building": {"merged": 0, "pairs": 1},
    }  # fmt: skip
    assert summary["cpu_s"]["median"] == 3.5


def test_a_method_without_a_verdict_merges_nothing_and_says_so():
    outcome = Outcome(made_pair(), TRUTH, True, None, None, 1.0)
    assert summarise(MethodResult("Fourier-Mellin", (outcome,), 1.0))["merged"] is None


@pytest.fixture(scope="module")
def pair_folder(tmp_path_factory):
    """Two maps of the office, a quarter turn apart, and a wrong pair."""
    folder = tmp_path_factory.mktemp("pairs")
    world = office()
    grid = OccupancyGrid(np.where(world.occupied, 4.0, -3.0).astype(np.float32), world.resolution_m, world.origin)
    T_b_a = np.array([3.0, 1.0, 1.6])
    for name, pose in (("a", se2.IDENTITY), ("b", T_b_a)):
        raster = raster_around(se2.transform_points(pose, known_corners(grid)), 0.05)
        write_map(folder / name, OccupancyGrid(resample(grid, pose, raster), 0.05, raster.origin))
    points_a = np.random.default_rng(0).uniform(2.0, 10.0, (40, 2))
    truth = PairTruth(se2.inverse(T_b_a), points_a, se2.transform_points(T_b_a, points_a))
    a, b = folder / "a.yaml", folder / "b.yaml"
    pairs = [
        MapPair("one office", a, b, "office", "office", "lidar", "high", 1.0, 80.0, truth),
        MapPair("said to be wrong", a, b, "office", "elsewhere", "lidar"),
    ]
    write_pairs(folder, pairs, "simulated")
    return folder


@pytest.mark.parametrize("name", METHODS)
def test_every_method_takes_pairs_and_reports_all_of_them(name, pair_folder):
    pairs = read_pairs(pair_folder)
    result = bench_method(name, pairs, 0)
    assert [outcome.pair.name for outcome in result.outcomes] == ["one office", "said to be wrong"]
    assert result.outcomes[0].right or name == "thesis, literal"  # these settings find little in one office
    assert not result.outcomes[1].right
    assert all(outcome.cpu_s > 0.0 for outcome in result.outcomes)
    assert Counter(outcome.merges is None for outcome in result.outcomes)[True] == 2 * (name == "Fourier-Mellin")


def test_the_command_prints_what_it_writes(pair_folder, cli, tmp_path):
    chosen = ("--method", "Fourier-Mellin", "--method", "m-explore ORB")
    ended = cli("bench", "fusion", pair_folder, *chosen, "--json", "-o", tmp_path / "out")
    assert ended.code == 0, ended.err
    report = json.loads(ended.out)
    assert report == json.loads((tmp_path / "out/report.json").read_text())
    assert (report["sampled"], report["of"], report["seed"]) == (2, 2, 0)
    assert [method["name"] for method in report["methods"]] == ["Fourier-Mellin", "m-explore ORB"]
    assert {name: len(rows) for name, rows in report["rows"].items()} == {"Fourier-Mellin": 2, "m-explore ORB": 2}


def test_the_table_names_each_method_and_what_it_has_no_verdict_on(pair_folder, cli):
    ended = cli("bench", "fusion", pair_folder, "--method", "Fourier-Mellin", "--sample", "1")
    assert ended.code == 0, ended.err
    assert "1 of 2 pairs" in ended.out
    assert "no verdict" in ended.out
    assert "1/1" in ended.out


def test_a_name_that_no_method_has_is_wrong_use(pair_folder, cli):
    ended = cli("bench", "fusion", pair_folder, "--method", "guessing")
    assert (ended.code, len(ended.error_lines)) == (2, 1)
    assert "Fourier-Mellin" in ended.error_lines[0]


def test_a_folder_without_a_list_is_one_line(cli, tmp_path):
    ended = cli("bench", "fusion", tmp_path)
    assert (ended.code, len(ended.error_lines)) == (1, 1)
    assert not (tmp_path / "runs").exists()
