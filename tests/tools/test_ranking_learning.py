"""Learning of the ranking, on pools made up here: right hypotheses show more net wall, and no other feature tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.evidence import TRENDS
from fusion.ranking import probabilities, read_ranking
from tools.errors import ToolError
from tools.hypothesis_pools import HypothesisPool
from tools.ranking_learning import (
    Growth,
    curve,
    held_out_scores,
    instructive,
    learned,
    left_out_groups,
    ranking_without,
    score_of,
    write_weights,
)

GROWTH = Growth(trees=20, depth=3, least_leaf=5)
NAMES = list(TRENDS)
NET = NAMES.index("net_middle")
BUILDINGS = ("hall", "house", "mill", "barn")


def made_up(seed: int, buildings: tuple[str, str], *, true: bool) -> HypothesisPool:
    """Ten hypotheses, each a place of its own; of a true pair the first is right, and has 5 more of net wall."""
    random = np.random.default_rng(seed)
    features = random.normal(0.0, 1.0, (10, len(NAMES)))
    right = np.zeros(10, np.bool_)
    if true:
        right[0] = True
        features[0, NET] += 5.0
    order = random.permutation(10)
    return HypothesisPool(str(seed), buildings, true, features[order], right[order], ~np.eye(10, dtype=np.bool_))


@pytest.fixture(scope="module")
def pools():
    made = [made_up(n, (BUILDINGS[n % 4],) * 2, true=n % 3 > 0) for n in range(160)]
    return [*made, *(made_up(1000 + n, ("hall", "mill"), true=False) for n in range(20))]


@pytest.fixture(scope="module")
def held_out(pools):
    return held_out_scores(pools, GROWTH)


@pytest.fixture(scope="module")
def ranking(pools, held_out, tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "weights.json"
    write_weights(path, learned(pools, GROWTH, "a test", held_out))
    return read_ranking(path)


def test_right_ones_stand_above_wrong_ones_in_pools_it_has_not_seen(ranking):
    found = [score_of(ranking, made_up(n, ("new", "new"), true=True))[1] for n in range(2000, 2060)]
    assert np.mean(found) > 0.9


def test_a_probability_is_kept(ranking):
    unseen = [made_up(n, ("new", "new"), true=n % 3 > 0) for n in range(3000, 3300)]
    scores = [score_of(ranking, pool) for pool in unseen]
    told = np.array([ranking.calibrated(score) for score, _ in scores])
    right = np.array([is_right for _, is_right in scores])
    assert told.mean() == pytest.approx(right.mean(), abs=0.08)
    assert ((told - right) ** 2).mean() < 0.8 * right.mean() * (1.0 - right.mean())


def test_it_never_falls_where_the_evidence_rises(ranking):
    random = np.random.default_rng(9)
    for name, trend in TRENDS.items():
        if trend == 0:
            continue
        table = np.repeat(random.normal(0.0, 1.0, (1, len(NAMES))), 50, axis=0)
        table[:, NAMES.index(name)] = np.linspace(-4.0, 6.0, 50)
        rises = np.diff(ranking.log_odds(dict(zip(NAMES, table.T, strict=True)))) * trend
        assert (rises >= -1e-9).all()


def test_right_hypotheses_have_better_odds_than_wrong_ones(ranking, pools):
    table = np.vstack([pool.features for pool in pools])
    right = np.concatenate([pool.right for pool in pools])
    odds = ranking.log_odds(dict(zip(NAMES, table.T, strict=True)))
    assert odds[right].mean() > odds[~right].mean() + 2.0
    assert probabilities(odds)[right].mean() > 5.0 * probabilities(odds)[~right].mean()
    assert ranking.origin == "a test"


def test_same_pools_same_text(pools, held_out, tmp_path):
    for name in ("one", "two"):
        write_weights(tmp_path / name, learned(pools, GROWTH, "a test", held_out))
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_the_best_wrong_ones_and_all_right_ones_are_learned_from(pools):
    for pool in pools[:30]:
        chosen = instructive(pool)
        assert chosen[pool.right].all()
        assert chosen[np.argsort(-pool.features[:, NET])[:6]].all()
    many = replace(
        pools[0],
        features=np.tile(np.arange(100.0)[:, np.newaxis], len(NAMES)),
        right=np.arange(100) == 3,
        different=np.zeros((100, 100), np.bool_),
    )
    assert np.flatnonzero(instructive(many)).tolist() == [3, *range(94, 100)]


def test_a_group_is_scored_by_trees_that_saw_neither_of_its_buildings(pools, held_out):
    """Net wall is worth nothing in the pools of one building: what is learned without it is as if it were not there."""
    assert list(left_out_groups(pools)) == [{"barn"}, {"hall"}, {"hall", "mill"}, {"house"}, {"mill"}]
    left_out = frozenset(("hall", "mill"))
    spoilt = [
        replace(pool, features=-5.0 * pool.features) if not left_out.isdisjoint(pool.buildings) else pool
        for pool in pools
    ]
    again = held_out_scores(spoilt, GROWTH)
    table = dict(zip(NAMES, np.random.default_rng(0).normal(0.0, 2.0, (len(NAMES), 100)), strict=True))
    same, others = (
        ranking_of.log_odds(table) for ranking_of in (held_out.rankings[left_out], again.rankings[left_out])
    )
    assert (same == others).all()
    barn = frozenset(("barn",))
    assert (held_out.rankings[barn].log_odds(table) != again.rankings[barn].log_odds(table)).any()
    assert ranking_without(held_out, left_out).log_odds(table).tolist() == same.tolist()


def test_the_curve_gives_the_share_of_right_ones(held_out):
    slope, offset = curve(held_out.scores, held_out.right)
    assert slope > 0.0
    odds = np.log(np.clip(held_out.scores, 1e-6, 1 - 1e-6) / (1.0 - np.clip(held_out.scores, 1e-6, 1 - 1e-6)))
    told = 1.0 / (1.0 + np.exp(-slope * odds - offset))
    assert told.mean() == pytest.approx(held_out.right.mean(), abs=0.01)


def test_the_score_falls_where_another_place_is_as_good(ranking):
    pool = made_up(7, ("new", "new"), true=True)
    alone = replace(pool, different=np.zeros((10, 10), np.bool_))
    rival = replace(
        pool,
        features=np.vstack([pool.features[pool.right]] * 2),
        right=np.array([True, False]),
        different=~np.eye(2, dtype=np.bool_),
    )
    assert score_of(ranking, rival)[0] < score_of(ranking, alone)[0]
    assert score_of(ranking, rival)[0] <= 0.25


def test_a_pool_without_hypotheses_is_a_score_of_none(ranking, pools):
    empty = replace(
        pools[0],
        features=np.empty((0, len(NAMES))),
        right=np.empty(0, np.bool_),
        different=np.empty((0, 0), np.bool_),
    )
    assert score_of(ranking, empty) == (0.0, False)
    assert instructive(empty).shape == (0,)


def test_too_little_to_learn_from_is_told(pools, held_out):
    one_building = [pool for pool in pools if set(pool.buildings) == {"hall"}]
    with pytest.raises(ToolError, match="of 1 building: to calibrate"):
        held_out_scores(one_building, GROWTH)
    with pytest.raises(ToolError, match="buildings left out are all wrong"):
        curve(np.array([0.3, 0.4]), np.array([False, False]))
    with pytest.raises(ToolError, match="without castle there is nothing to learn from"):
        ranking_without(held_out, frozenset(("castle",)))
