"""`learn` and `evaluate registration --leave-one-out`: weights from pairs, and a registration that never saw a pair."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fusion.ranking import read_ranking
from tools.hypothesis_pools import keyed_pairs, pools_of
from tools.pair_files import write_pairs
from tools.pair_making import WindowPlan, window_pairs
from tools.registration_evaluation import chosen_pairs, left_out_registrations


@pytest.fixture(scope="module")
def lists(corridor_drive, tmp_path_factory):
    """Two lists of two true and one wrong pair each, as if of two buildings."""
    folder = tmp_path_factory.mktemp("lists")
    for number, building in enumerate(("hall", "mill")):
        (folder / building).mkdir()
        scans = replace(corridor_drive, building=building)
        made = window_pairs(folder / building, scans, WindowPlan(2, 1, ("lidar",), 60), number)
        true = [pair for pair in made if pair.band == "high"][:2]
        write_pairs(folder / building, [*true, *(pair for pair in made if pair.truth is None)], "a test")
    return folder / "hall", folder / "mill"


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache") / "pools.npz"


def test_weights_are_learned_and_the_same_again(lists, cache, cli, tmp_path):
    for name in ("one.json", "two.json"):
        outcome = cli("learn", *lists, "-o", tmp_path / name, "--cache", cache)
        assert outcome.code == 0, outcome.err
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
    assert cache.is_file()
    ranking = read_ranking(tmp_path / "one.json")
    assert ranking.origin == "6 pairs: mapfuse-robot learn hall mill --seed 0"
    row = next(line for line in outcome.out.splitlines() if line.startswith("all "))
    assert [int(cell) for cell in row.split()[1:3]] == [4, 4]


def test_every_pair_is_registered_by_weights_of_other_buildings(lists, cache, cli):
    """With one list alone there is no other building; with the other list there is."""
    outcome = cli("evaluate", "registration", lists[0], "--leave-one-out", lists[1], "--cache", cache, "--json")
    assert outcome.code == 0, outcome.err
    assert '"leave_one_out": [\n    "mill"\n  ]' in outcome.out
    assert outcome.out.count('"building_a": "hall"') == 3


def test_the_registration_of_a_pair_has_the_ranking_without_its_buildings(lists, cache):
    pairs = [pair for folder in lists for pair in chosen_pairs(folder, [], None, 0)]
    keyed = {key: pair for folder in lists for key, pair in keyed_pairs(folder).items()}
    registered = left_out_registrations(pairs, pools_of(keyed, 0, 1, cache, lambda _: None), lambda _: None)
    rankings = [each.args[0] for each in registered]  # type: ignore[attr-defined]
    assert len(rankings) == 6
    assert [each.origin for each in rankings] == ["without hall"] * 3 + ["without mill"] * 3


def test_bad_input_is_one_line(lists, cache, cli, tmp_path):
    for arguments, code in (
        (["learn", tmp_path / "none", "-o", tmp_path / "w.json"], 1),
        (["learn", lists[0], "-o", tmp_path / "none/w.json"], 1),
        (["learn", lists[0], "-o", tmp_path / "w.json", "--cache", cache], 1),
        (["evaluate", "registration", lists[0], "--cache", cache], 2),
        (["learn", *lists, "-o", tmp_path / "w.json", "--cache", cache, "--seed", "1"], 1),
        (["evaluate", "registration", lists[0], "--method", "thesis", "--leave-one-out", lists[1]], 2),
        (["evaluate", "registration", lists[0], "--leave-one-out", lists[0], "--cache", cache], 1),
    ):
        outcome = cli(*arguments)
        assert (outcome.code, len(outcome.error_lines)) == (code, 1), outcome.err
        assert not (tmp_path / "w.json").exists()
