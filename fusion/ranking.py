"""How probable is each hypothesis? A learned weighing of the evidence, as boosted decision trees in a text file.

The trees never fall where more wall agrees and never rise where more contradicts (monotone constraints), and each
compares named pieces of evidence with thresholds: the file can be read. It is made by `mapfuse-robot learn` from named
pairs of maps; see docs/fusion.md.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.errors import FusionError

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
FORMAT, VERSION = "mapfuse-ranking", 1
SHIPPED = Path(__file__).with_name("ranking_weights.json")


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """Trees over named features, and the calibration of a pair's score.

    feature, threshold, low, high, value (T, N): node n of tree t sends a hypothesis to node `low` if its feature is at
    most the threshold, else to `high`; a leaf has feature -1 and adds its value to the log-odds, which start at base.
    slope, offset: log-odds of being right = slope * log-odds of the score + offset (Platt 1999).
    """

    names: tuple[str, ...]
    base: float
    feature: IndexArray
    threshold: FloatArray
    low: IndexArray
    high: IndexArray
    value: FloatArray
    slope: float
    offset: float
    origin: str

    def log_odds(self, features: dict[str, FloatArray]) -> FloatArray:
        """Return the log-odds (K,) that each hypothesis is right, taken by itself."""
        table = np.column_stack([features[name] for name in self.names])
        trees, rows = np.arange(len(self.feature))[:, np.newaxis], np.arange(len(table))
        node = np.zeros((len(trees), len(table)), dtype=np.int64)  # where each hypothesis stands in each tree
        while (inner := self.feature[trees, node] >= 0).any():
            asked = np.maximum(self.feature[trees, node], 0)
            goes_low = table[rows, asked] <= self.threshold[trees, node]
            following = np.where(goes_low, self.low[trees, node], self.high[trees, node])
            node = np.where(inner, following, node)
        return np.asarray(self.base + self.value[trees, node].sum(axis=0))

    def calibrated(self, score: float) -> float:
        """Return the probability that a pair's best hypothesis is right, given p1 (1 - p2)."""
        clipped = min(max(score, 1e-6), 1.0 - 1e-6)
        return float(_logistic(self.slope * np.log(clipped / (1.0 - clipped)) + self.offset))


def read_ranking(path: Path) -> Ranking:
    """Read the text file that `learn` writes; raises FusionError for any other."""
    try:
        stored: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if (stored["format"], stored["version"]) != (FORMAT, VERSION):
            raise FusionError(f"{path}: {stored['format']} version {stored['version']}, expected {FORMAT} {VERSION}")
        return ranking_from(stored)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FusionError(f"{path}: no ranking weights ({error!r}): make them with `mapfuse-robot learn`") from error


def ranking_from(stored: dict[str, Any]) -> Ranking:
    """Return the ranking that nested trees {"if", "at_most", "then", "else"} or leaves (numbers) describe."""
    names = tuple(stored["features"])
    trees = [_flattened(tree, names) for tree in stored["trees"]]
    longest = max(len(tree) for tree in trees)
    table = np.zeros((len(trees), longest, 5))
    table[:, :, 0] = -1.0
    for tree, nodes in zip(table, trees, strict=True):
        tree[: len(nodes)] = nodes
    index = table.astype(np.int64)
    return Ranking(
        names, float(stored["base"]), index[:, :, 0], table[:, :, 1], index[:, :, 2], index[:, :, 3], table[:, :, 4],
        float(stored["slope"]), float(stored["offset"]), str(stored["origin"]),
    )  # fmt: skip


@cache
def shipped_ranking() -> Ranking:
    """Return the ranking that comes with the program."""
    return read_ranking(SHIPPED)


def probabilities(log_odds: FloatArray) -> FloatArray:
    """Return p (K,) of log-odds (K,)."""
    return np.asarray(_logistic(log_odds))


def _logistic(value: Any) -> Any:
    return 1.0 / (1.0 + np.exp(-np.clip(value, -50.0, 50.0)))


def _flattened(tree: Any, names: tuple[str, ...]) -> list[list[float]]:
    """Return nodes [feature, threshold, low, high, value] of a nested tree, the root first."""
    nodes: list[list[float]] = []

    def add(node: Any) -> int:
        place = len(nodes)
        if isinstance(node, (int, float)):
            nodes.append([-1.0, 0.0, 0.0, 0.0, float(node)])
            return place
        nodes.append([float(names.index(node["if"])), float(node["at_most"]), 0.0, 0.0, 0.0])
        nodes[place][2] = float(add(node["then"]))
        nodes[place][3] = float(add(node["else"]))
        return place

    add(tree)
    return nodes
