"""`learn`: the weights of the ranking, made from pairs of maps whose truth is known.

Boosted decision trees with monotone constraints (scikit-learn's histogram gradient boosting) weigh the evidence for
each hypothesis; a logistic curve (Platt 1999), fitted to pairs of buildings that the trees were not grown on, turns the
score of a pair into a probability.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.wording import counted
from fusion.evidence import TRENDS
from fusion.ranking import FORMAT, VERSION, Ranking, probabilities, ranking_from
from tools.errors import ToolError
from tools.hypothesis_pools import HypothesisPool
from tools.results import writing_to

FloatArray = NDArray[np.float64]
_DIGITS = 5  # of the numbers in the file
# By these the best wrong hypotheses are found.
_TEMPTING = (
    "net_sharp",
    "net_middle",
    "net_wide",
    "log_good_blocks",
    "bent_net_sharp",
    "bent_net_middle",
    "bent_log_good_blocks",
)
_TEMPTING_EACH = 6


@dataclass(frozen=True, slots=True)
class Growth:
    """How the trees are grown: their number and depth, the rate, the least hypotheses in a leaf, the L2 penalty."""

    trees: int = 250
    depth: int = 4
    rate: float = 0.05
    least_leaf: int = 60
    l2: float = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """What is said of P pairs by trees that were grown without their buildings.

    rankings: by the set of buildings left out, without a curve; pools: the pairs; scores (P,): as a registration gives
    them; right (P,): the best hypothesis is.
    """

    rankings: dict[frozenset[str], Ranking]
    pools: tuple[HypothesisPool, ...]
    scores: FloatArray
    right: NDArray[np.bool_]


def check_installed() -> None:
    """Raise ToolError where scikit-learn is missing, which is an extra: learning needs it, registering does not."""
    try:
        import sklearn  # noqa: F401
    except ImportError as error:
        raise ToolError("scikit-learn is not installed: pip install 'mapfuse-robot[learn]'") from error


def held_out_scores(
    pools: Sequence[HypothesisPool], growth: Growth, on_progress: Callable[[str], None] = lambda _: None, jobs: int = 1
) -> HeldOut:
    """Score every pair by trees grown on the pairs that touch none of its buildings, in so many processes.

    Pairs for which there is nothing to learn from are left out. Raises ToolError where a curve cannot be fitted.
    """
    groups = left_out_groups(pools)
    rankings: dict[frozenset[str], Ranking] = {}
    judged: list[tuple[HypothesisPool, float, bool]] = []
    for number, (left_out, ranking) in enumerate(_rankings_without(pools, [*groups], growth, jobs), start=1):
        on_progress(f"{number} of {len(groups)}: without {' and '.join(sorted(left_out))}")
        if ranking is not None:
            rankings[left_out] = ranking
            judged += [(pool, *score_of(ranking, pool)) for pool in groups[left_out]]
    if len({right for _, _, right in judged}) < 2:
        buildings = len({name for pool in pools for name in pool.buildings})
        raise ToolError(
            f"{counted(len(pools), 'pair')} of {counted(buildings, 'building')}: to calibrate, right and wrong results "
            "on buildings left out are needed: give pairs of more buildings, and wrong ones"
        )
    taken, scores, right = zip(*judged, strict=True)
    return HeldOut(rankings, taken, np.array(scores), np.array(right, np.bool_))


def _rankings_without(
    pools: Sequence[HypothesisPool], groups: Sequence[frozenset[str]], growth: Growth, jobs: int
) -> Iterator[tuple[frozenset[str], Ranking | None]]:
    """Yield each set of buildings with the ranking of pairs that touch none; None where nothing is to learn from."""
    if jobs <= 1 or len(groups) < 2:
        for left_out in groups:
            yield left_out, _ranking_without(pools, growth, left_out)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_hold, initargs=(pools, growth)) as processes:
        yield from zip(groups, processes.map(_held_ranking_without, groups), strict=True)


_held: list[tuple[Sequence[HypothesisPool], Growth]] = []  # in a worker process: what it learns from, sent once


def _hold(pools: Sequence[HypothesisPool], growth: Growth) -> None:
    os.environ["OMP_NUM_THREADS"] = "1"  # read by scikit-learn's trees when they are first imported
    _held[:] = [(pools, growth)]


def _held_ranking_without(left_out: frozenset[str]) -> Ranking | None:
    return _ranking_without(*_held[0], left_out)


def _ranking_without(pools: Sequence[HypothesisPool], growth: Growth, left_out: frozenset[str]) -> Ranking | None:
    kept = [pool for pool in pools if left_out.isdisjoint(pool.buildings)]
    if not any(pool.right.any() for pool in kept):
        return None
    return ranking_from(_stored(_classifier(kept, growth), f"without {', '.join(sorted(left_out))}"))


def learned(pools: Sequence[HypothesisPool], growth: Growth, origin: str, held_out: HeldOut) -> dict[str, Any]:
    """Return the weights as they are stored: trees of all pools, and the curve of those that were held out."""
    slope, offset = curve(held_out.scores, held_out.right)
    return _stored(_classifier(pools, growth), origin) | {"slope": slope, "offset": offset}


def ranking_without(held_out: HeldOut, left_out: frozenset[str]) -> Ranking:
    """Return the ranking, trees and curve, of the pairs that touch none of these buildings; raises ToolError.

    The scores behind the curve are those of other buildings' pairs, by trees that did see these.
    """
    if left_out not in held_out.rankings:
        names = ", ".join(sorted(left_out))
        raise ToolError(f"without {names} there is nothing to learn from: give training pairs of other buildings")
    seen = np.array([left_out.isdisjoint(pool.buildings) for pool in held_out.pools], np.bool_)
    slope, offset = curve(held_out.scores[seen], held_out.right[seen])
    return replace(held_out.rankings[left_out], slope=slope, offset=offset)


def left_out_groups(pools: Sequence[HypothesisPool]) -> dict[frozenset[str], list[HypothesisPool]]:
    """Return the pools by their set of buildings, in the order of the names."""
    groups: dict[frozenset[str], list[HypothesisPool]] = {}
    for pool in pools:
        groups.setdefault(frozenset(pool.buildings), []).append(pool)
    return {names: groups[names] for names in sorted(groups, key=sorted)}


def score_of(ranking: Ranking, pool: HypothesisPool) -> tuple[float, bool]:
    """Return the score of a pool's best hypothesis, as a registration gives it, and whether it is right."""
    if len(pool.right) == 0:
        return 0.0, False
    probability = probabilities(ranking.log_odds(dict(zip(TRENDS, pool.features.T, strict=True))))
    best = int(np.argmax(probability))
    rivals = probability[pool.different[best]]
    return float(probability[best]) * (1.0 - float(rivals.max(initial=0.0))), bool(pool.right[best])


def instructive(pool: HypothesisPool) -> NDArray[np.bool_]:
    """Return which hypotheses (K,) are learned from: the right ones, and those that a simple count would put first."""
    chosen: NDArray[np.bool_] = pool.right.copy()
    for name in _TEMPTING:
        column = pool.features[:, list(TRENDS).index(name)]
        chosen[np.argsort(-column, kind="stable")[:_TEMPTING_EACH]] = True
    return chosen


def curve(scores: FloatArray, right: NDArray[np.bool_]) -> tuple[float, float]:
    """Return slope and offset of the logistic curve that turns scores (P,) into shares of right ones (P,)."""
    if right.all() or not right.any():
        kind = "right" if right.all() else "wrong"
        raise ToolError(f"{len(right)} pairs of buildings left out are all {kind}: a curve needs both")
    from sklearn.linear_model import LogisticRegression

    clipped = np.clip(scores, 1e-6, 1.0 - 1e-6)
    fitted = LogisticRegression(C=1e3).fit(np.log(clipped / (1.0 - clipped))[:, np.newaxis], right)
    return _rounded(fitted.coef_[0, 0]), _rounded(fitted.intercept_[0])


def write_weights(path: Path, stored: dict[str, Any]) -> None:
    """Write the weights as text, one tree a line."""
    head = {name: value for name, value in stored.items() if name != "trees"}
    trees = ",\n".join(f"  {json.dumps(tree)}" for tree in stored["trees"])
    text = f'{json.dumps(head, indent=1)[:-2]},\n "trees": [\n{trees}\n ]\n}}\n'
    partial = path.with_name(f"{path.name}.part")
    with writing_to(path):
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)


def _classifier(pools: Sequence[HypothesisPool], growth: Growth) -> Any:
    """Return the fitted classifier; raises ToolError where there is nothing to learn."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    chosen = [instructive(pool) for pool in pools]
    right = np.concatenate([np.empty(0, np.bool_), *(p.right[kept] for p, kept in zip(pools, chosen, strict=True))])
    if right.all() or not right.any():
        raise ToolError(f"{len(right)} hypotheses are all {'right' if right.all() else 'wrong'}: nothing to learn from")
    classifier = HistGradientBoostingClassifier(
        max_iter=growth.trees,
        max_depth=growth.depth,
        learning_rate=growth.rate,
        min_samples_leaf=growth.least_leaf,
        l2_regularization=growth.l2,
        monotonic_cst=list(TRENDS.values()),
        early_stopping=False,
        random_state=0,
    )
    return classifier.fit(np.vstack([pool.features[kept] for pool, kept in zip(pools, chosen, strict=True)]), right)


def _stored(classifier: Any, origin: str) -> dict[str, Any]:
    """Return the trees of a classifier in the file's form, without a curve."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "origin": origin,
        "features": list(TRENDS),
        "base": _rounded(classifier._baseline_prediction[0, 0]),
        "slope": 1.0,
        "offset": 0.0,
        "trees": [_nested(rounds[0].nodes, 0) for rounds in classifier._predictors],
    }


def _nested(nodes: Any, number: int) -> Any:
    """Return a tree as nested comparisons; its leaves are numbers."""
    node = nodes[number]
    if node["is_leaf"]:
        return _rounded(node["value"])
    return {
        "if": list(TRENDS)[int(node["feature_idx"])],
        "at_most": _rounded(node["num_threshold"]),
        "then": _nested(nodes, int(node["left"])),
        "else": _nested(nodes, int(node["right"])),
    }


def _rounded(value: Any) -> float:
    return float(f"{float(value):.{_DIGITS}g}")
