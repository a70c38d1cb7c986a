"""What is to be expected of a learned ranking on a building that it was not learned from, as a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tools.ranking_learning import HeldOut

FloatArray = NDArray[np.float64]
_SURE = 0.9


def held_out_probabilities(held_out: HeldOut, curve: tuple[float, float]) -> FloatArray:
    """Return the probability (P,) of each pair that its best hypothesis is right; curve: slope and offset."""
    clipped = np.clip(held_out.scores, 1e-6, 1.0 - 1e-6)
    slope, offset = curve
    return np.asarray(1.0 / (1.0 + np.exp(-slope * np.log(clipped / (1.0 - clipped)) - offset)))


def held_out_lines(held_out: HeldOut, curve: tuple[float, float]) -> list[str]:
    """Return the table: by building, and over all, what trees do that were grown without a pair's buildings.

    Sure is a probability of 0.9; a registration refuses more of them, for other reasons.
    """
    probability = held_out_probabilities(held_out, curve)
    sure = probability >= _SURE
    true = np.array([pool.true for pool in held_out.pools], np.bool_)
    reachable = np.array([bool(pool.right.any()) for pool in held_out.pools], np.bool_)
    names = [" and ".join(sorted(set(pool.buildings))) for pool in held_out.pools]
    same = np.array([len(set(pool.buildings)) == 1 for pool in held_out.pools], np.bool_)
    lines = ["buildings left out           true  in pool      best  sure+right   sure+wrong    apart  sure+wrong"]

    def row(name: str, inside: NDArray[np.bool_]) -> str:
        one, two = inside & true, inside & ~true
        counts = [one, one & reachable, one & held_out.right, one & held_out.right & sure, one & ~held_out.right & sure]
        cells: Sequence[int] = [int(np.count_nonzero(each)) for each in (*counts, two, two & sure)]
        widths = (5, 8, 9, 11, 12, 8, 11)
        return f"{name:27} " + " ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True))

    for building in sorted({name for name, is_same in zip(names, same.tolist(), strict=True) if is_same}):
        lines += [row(building, np.array([name == building for name in names], np.bool_))]
    lines += [row("two buildings", ~same), row("all", np.ones(len(names), np.bool_))]
    brier = float(((probability - held_out.right) ** 2).mean())
    return [*lines, f"probability that the best is right: Brier score {brier:.4f}, {len(names)} pairs"]
