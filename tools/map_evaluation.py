"""`evaluate maps`: how often registration is right, refuses or is wrong, on pairs of real maps."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from fusion.alignment import Alignment
from fusion.evaluation import error_at_points
from fusion.registration import Method, register
from tools.map_pairs import MapPair, map_pairs
from tools.results import Report

PRECISE_M, PRECISE_DEG = 0.10, 1.0


def evaluate_maps(data: Path, method: Method, seed: int, on_progress: Callable[[str], None]) -> Report:
    """Register every pair of `map_pairs`; return a row for each, failures included, and the counts."""
    rows = []
    for pair in map_pairs(data, seed):
        started = time.perf_counter()
        alignment = register(pair.a, pair.b, method, seed)
        row = judged(pair, alignment) | {"seconds": round(time.perf_counter() - started, 3)}
        rows.append(row)
        on_progress(f"{row['pair']}: {row['verdict']} ({row['reason']})")
    same = [row for row in rows if row["same_place"]]
    different = Counter(row["verdict"] for row in rows if not row["same_place"])
    verdicts = Counter(row["verdict"] for row in same)
    return {
        "method": method,
        "seed": seed,
        "same_place": {
            "pairs": len(same),
            "right": verdicts["right"],
            "within_0.10_m_and_1_deg": sum(bool(row["precise"]) for row in same),
            "refused": verdicts["refused"] + verdicts["refused, pose was right"],
            "refused_though_right": verdicts["refused, pose was right"],
            "wrong": verdicts["WRONG"],
        },
        "different_places": {"pairs": different.total(), "accepted": different["WRONG"]},
        "rows": rows,
    }


def judged(pair: MapPair, alignment: Alignment) -> Report:
    """Return the row of one pair: errors, and the verdict right, refused or WRONG."""
    row: Report = {"pair": pair.name, "same_place": pair.truth is not None, "accepted": alignment.accepted}
    row |= {"rms_m": None, "rotation_deg": None, "precise": False, "reason": alignment.reason}
    right = False
    if pair.truth is not None and alignment.T_a_b is not None:
        error = error_at_points(pair.truth.points_a, pair.truth.points_b, alignment.T_a_b, pair.truth.T_a_b)
        right = error.rms_m <= pair.truth.right_m and error.rotation_deg <= pair.truth.right_deg
        precise = error.rms_m <= PRECISE_M and error.rotation_deg <= PRECISE_DEG
        row |= {"rms_m": round(error.rms_m, 4), "rotation_deg": round(error.rotation_deg, 3)}
        row["precise"] = alignment.accepted and precise
    if alignment.accepted:
        row["verdict"] = "right" if right else "WRONG"
    else:
        row["verdict"] = "refused, pose was right" if right else "refused"
    return row
