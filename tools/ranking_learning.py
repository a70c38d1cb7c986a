"""`learn`: the weights of the ranking, made from pairs of maps whose truth is known.

Boosted decision trees with monotone constraints (scikit-learn's histogram gradient boosting) weigh the evidence for each
hypothesis; a logistic curve (Platt 1999), fitted on buildings that the trees were not grown on, turns the score of a
pair into a probability. Leaving one building out at a time tells what to expect on a new one.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.evidence import TRENDS
from fusion.ranking import FORMAT, VERSION, Ranking, probabilities, ranking_from
from tools.errors import ToolError
from tools.results import writing_to

FloatArray = NDArray[np.float64]
_DIGITS = 5  # of the thresholds in the file


@dataclass(frozen=True, slots=True)
class Growth:
    """How the trees are grown: their number and depth, the rate, the least hypotheses in a leaf, the L2 penalty."""

    trees: int = 120
    depth: int = 4
    rate: float = 0.08
    least_leaf: int = 15
    l2: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPool:
    """The hypotheses of one pair: features (K, F) in TRENDS' order, which are right (K,), which are other places (K, K)."""

    buildings: tuple[str, str]
    features: FloatArray
    right: NDArray[np.bool_]
    different: NDArray[np.bool_]


def grow(pools: Sequence[JudgedPool], growth: Growth, origin: str) -> dict[str, Any]:
    """Return the weights as they are stored, learned from all pools, the curve from trees that leave a building out."""
    buildings = sorted({name for pool in pools for name in pool.buildings})
    scores, right = [], []
    for building in buildings:
        left_out = [pool for pool in pools if pool.buildings[0] == building]
        kept = [pool for pool in pools if building not in pool.buildings]
        if not left_out or not any(pool.right.any() for pool in kept):
            continue
        ranking = ranking_from(_stored(_trees(kept, growth), origin))
        for pool in left_out:
            score, is_right = _score(ranking, pool)
            scores.append(score)
            right.append(is_right)
    slope, offset = _curve(np.array(scores), np.array(right))
    return _stored(_trees(pools, growth), origin) | {"slope": slope, "offset": offset}


def write_weights(path: Path, stored: dict[str, Any]) -> None:
    """Write the weights as text, one tree a line."""
    head = {name: value for name, value in stored.items() if name != "trees"}
    lines = [json.dumps(head, indent=1)[:-2] + ","]
    trees = ",\n".join(f"  {json.dumps(tree)}" for tree in stored["trees"])
    lines.append(f' "trees": [\n{trees}\n ]\n}}\n')
    with writing_to(path):
        path.write_text("\n".join(lines), encoding="utf-8")


def _trees(pools: Sequence[JudgedPool], growth: Growth) -> Any:
    """Return the fitted classifier; raises ToolError where scikit-learn is missing."""
    try:
        from sklearn.ensemble import HistGradientBoostingClassifier
    except ImportError as error:
        raise ToolError("scikit-learn is not installed: pip install 'mapfuse-robot[learn]'") from error
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
    right = np.concatenate([pool.right for pool in pools])
    if right.all() or not right.any():
        raise ToolError(f"{len(right)} hypotheses are all {'right' if right.all() else 'wrong'}: nothing to learn from")
    return classifier.fit(np.vstack([pool.features for pool in pools]), right)


def _stored(classifier: Any, origin: str) -> dict[str, Any]:
    """Return the trees of a classifier in the file's form, without a curve."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "origin": origin,
        "features": list(TRENDS),
        "base": float(classifier._baseline_prediction[0, 0]),
        "slope": 1.0,
        "offset": 0.0,
        "trees": [_nested(rounds[0].nodes, 0) for rounds in classifier._predictors],
    }


def _nested(nodes: Any, number: int) -> Any:
    """Return a tree as nested comparisons; its leaves are numbers."""
    node = nodes[number]
    if node["is_leaf"]:
        return float(f"{node['value']:.{_DIGITS}g}")
    return {
        "if": list(TRENDS)[int(node["feature_idx"])],
        "at_most": float(f"{node['num_threshold']:.{_DIGITS}g}"),
        "then": _nested(nodes, int(node["left"])),
        "else": _nested(nodes, int(node["right"])),
    }


def _score(ranking: Ranking, pool: JudgedPool) -> tuple[float, bool]:
    """Return the score of a pool's best hypothesis, as a registration gives it, and whether it is right."""
    probability = probabilities(ranking.log_odds(dict(zip(TRENDS, pool.features.T, strict=True))))
    best = int(np.argmax(probability))
    rivals = probability[pool.different[best]]
    return float(probability[best]) * (1.0 - float(rivals.max(initial=0.0))), bool(pool.right[best])


def _curve(scores: FloatArray, right: NDArray[np.bool_]) -> tuple[float, float]:
    """Return slope and offset of the logistic curve that turns scores (N,) into shares of right ones."""
    from sklearn.linear_model import LogisticRegression

    clipped = np.clip(scores, 1e-6, 1.0 - 1e-6)
    fitted = LogisticRegression(C=1e3).fit(np.log(clipped / (1.0 - clipped))[:, np.newaxis], right)
    return float(f"{fitted.coef_[0, 0]:.4g}"), float(f"{fitted.intercept_[0]:.4g}")
