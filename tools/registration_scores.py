"""Rows of a registration's evaluation, counted: success by group, wrong merges, calibration, accuracy and time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from tools.pair_files import BANDS, KINDS
from tools.results import Report

Rows = Sequence[Report]
WALLS_M = (0.0, 3.0, 8.0, 20.0, math.inf)
_FIFTHS = 5
_NEES_95 = 7.815  # of 3 degrees of freedom: 95 % of the errors are below where the covariance is true


def summary_of(rows: Rows) -> Report:
    """Return all counts of the rows that `registration_evaluation.judged` made."""
    true = [row for row in rows if row["true"]]
    wrong = [row for row in rows if not row["true"]]
    return {
        "true_pairs": _success(true),
        "by_band": _grouped([row for row in true if row["kind"] == "lidar"], BANDS, lambda row: row["band"]),
        "by_kind": _grouped(true, KINDS, lambda row: row["kind"]),
        "by_common_wall": _grouped([row for row in true if row["kind"] != "warped"], _wall_names(), _wall_of),
        "by_building": _grouped(true, sorted({row["building_a"] for row in true}), lambda row: row["building_a"]),
        "false_merges": {
            "same_building": _merges([row for row in wrong if row["building_a"] == row["building_b"]]),
            "other_building": _merges([row for row in wrong if row["building_a"] != row["building_b"]]),
            "all": _merges(wrong),
        },
        "calibration": calibration(rows),
        "accuracy": {
            kind: accuracy([row for row in true if row["kind"] == kind and row["aligned"]])
            for kind in KINDS
            if any(row["kind"] == kind for row in true)
        },
        "covariance": consistency(true),
        "cpu_s": _spread([row["cpu_s"] for row in rows]),
        "failures": failures(rows),
    }


def calibration(rows: Rows) -> Report | None:
    """Return how far the probabilities are to be believed: that the best hypothesis is right, over all pairs.

    Where no pose was found at all, and no probability, it counts as 0. None where no row has a probability.
    """
    if all(row["probability"] is None for row in rows):
        return None
    p = np.array([row["probability"] or 0.0 for row in rows])
    right = np.array([row["aligned"] for row in rows], dtype=np.float64)
    fifth = np.minimum((p * _FIFTHS).astype(np.intp), _FIFTHS - 1)
    fifths = []
    for number in range(_FIFTHS):
        mine = fifth == number
        fifths.append(
            {
                "from": number / _FIFTHS,
                "to": (number + 1) / _FIFTHS,
                "pairs": int(mine.sum()),
                "mean_probability": round(float(p[mine].mean()), 3) if mine.any() else None,
                "right": round(float(right[mine].mean()), 3) if mine.any() else None,
            }
        )
    return {"brier": round(float(((p - right) ** 2).mean()), 4), "pairs": len(rows), "fifths": fifths}


def accuracy(aligned: Rows) -> Report:
    """Return the errors of right poses: medians and 95th percentiles."""
    if not aligned:
        return {"pairs": 0}
    errors = {key: np.array([row[key] for row in aligned]) for key in ("rms_m", "rotation_deg")}
    statistics = {
        f"{key}_{name}": round(float(np.percentile(values, share)), 4)
        for key, values in errors.items()
        for name, share in (("median", 50), ("p95", 95))
    }
    return {"pairs": len(aligned), **statistics}


def consistency(true: Rows) -> Report | None:
    """Return the normalised squared errors of right poses: mean (true to the covariance: 3) and share below 7.8 (95 %).

    None where no row has a covariance.
    """
    nees = np.array([row["nees"] for row in true if row["nees"] is not None])
    if len(nees) == 0:
        return None
    return {
        "pairs": len(nees),
        "mean": round(float(nees.mean()), 2),
        "median": round(float(np.median(nees)), 2),
        "below_7.8": round(float((nees < _NEES_95).mean()), 3),
    }


def failures(rows: Rows) -> list[Report]:
    """Return what went wrong, worst first: wrong poses accepted, right ones refused, poses missed."""
    kinds: tuple[tuple[str, Callable[[Report], bool]], ...] = (
        ("wrong, accepted", lambda row: row["accepted"] and not row["aligned"]),
        ("right, refused", lambda row: row["aligned"] and not row["accepted"]),
        ("misaligned, refused", lambda row: row["true"] and not row["aligned"] and not row["accepted"]),
    )
    keys = ("pair", "kind", "true", "probability", "common_wall_m", "rms_m", "rotation_deg", "reason")
    return [{"failure": name, **{key: row[key] for key in keys}} for name, fits in kinds for row in rows if fits(row)]


def table_of(report: Report) -> list[str]:
    """Return the lines of a summary as people read it."""
    head = f"{'aligned: best pose right':28} {'n':>5} {'aligned':>15} {'accepted, right':>15} {'accepted, wrong':>15}"
    lines = [head, _success_line("all true pairs", report["true_pairs"])]
    for title, key in (
        ("band, lidar", "by_band"),
        ("kind", "by_kind"),
        ("wall", "by_common_wall"),
        ("", "by_building"),
    ):
        lines.append("")
        lines += [_success_line(f"{title} {name}".strip(), group) for name, group in report[key].items()]
    lines += ["", "wrong pairs accepted"]
    for name, group in report["false_merges"].items():
        lines.append(f"  {name.replace('_', ' '):26} {group['accepted']} of {group['pairs']}{_bound(group)}")
    lines += ["", *_calibration_lines(report["calibration"]), "", "errors of the aligned, median / 95 %"]
    for kind, group in report["accuracy"].items():
        if group["pairs"]:
            moved = f"{group['rms_m_median']:.3f} / {group['rms_m_p95']:.3f} m"
            turned = f"{group['rotation_deg_median']:.2f} / {group['rotation_deg_p95']:.2f} deg"
            lines.append(f"  {kind:26} {moved:>18} {turned:>20}")
    nees = report["covariance"]
    if nees:
        below = f"{nees['below_7.8']:.0%} below 7.8 (95 % if true)"
        lines += [f"  covariance: NEES mean {nees['mean']:.2f} (3 if true), {below}, {nees['pairs']} pairs"]
    cpu = report["cpu_s"]
    if cpu["pairs"]:
        lines += ["", f"CPU s a pair: median {cpu['median']:.2f}, 95 % {cpu['p95']:.2f}, most {cpu['max']:.2f}"]
    return lines


def failure_lines(report: Report) -> list[str]:
    """Return a line for each failure, worst first."""
    lines = []
    for row in report["failures"]:
        p = "" if row["probability"] is None else f" p {row['probability']:.3f}"
        error = "" if row["rms_m"] is None else f", {row['rms_m']:.2f} m and {row['rotation_deg']:.1f} deg off"
        lines.append(f"{row['failure']:20} {row['pair']}{error}{p}: {row['reason']}")
    return lines


def _success(rows: Rows) -> Report:
    return {
        "pairs": len(rows),
        "aligned": sum(row["aligned"] for row in rows),
        "accepted_right": sum(row["aligned"] and row["accepted"] for row in rows),
        "accepted_wrong": sum(row["accepted"] and not row["aligned"] for row in rows),
    }


def _merges(rows: Rows) -> Report:
    """Return how many wrong pairs were accepted; at_most: 95 % bound of the rate where none was.

    A rate at which none of n would be accepted once in twenty times: (1 - rate)^n = 0.05; 3/n for many pairs.
    """
    accepted = sum(row["accepted"] for row in rows)
    bound = round(1.0 - 0.05 ** (1.0 / len(rows)), 4) if rows and not accepted else None
    return {"pairs": len(rows), "accepted": accepted, "at_most": bound}


def _grouped(rows: Rows, names: Iterable[str], name_of: Callable[[Report], str | None]) -> Report:
    groups = {name: [row for row in rows if name_of(row) == name] for name in names}
    return {name: _success(group) for name, group in groups.items() if group}


def _wall_names() -> list[str]:
    return [_wall_name(low, high) for low, high in pairwise(WALLS_M)]


def _wall_name(low_m: float, high_m: float) -> str:
    return f"{low_m:g}-{high_m:g} m" if math.isfinite(high_m) else f"over {low_m:g} m"


def _wall_of(row: Report) -> str | None:
    if row["common_wall_m"] is None:
        return None
    ranges = pairwise(WALLS_M)
    return next((_wall_name(low, high) for low, high in ranges if low <= row["common_wall_m"] < high), None)


def _spread(seconds: Sequence[float]) -> Report:
    if not seconds:
        return {"pairs": 0}
    return {
        "pairs": len(seconds),
        "median": round(float(np.median(seconds)), 3),
        "p95": round(float(np.percentile(seconds, 95)), 3),
        "max": round(float(max(seconds)), 3),
    }


def _success_line(name: str, group: Report) -> str:
    cells = [f"{group[key]:>6} ({group[key] / max(group['pairs'], 1):>5.1%})" for key in ("aligned", "accepted_right")]
    return f"{name:28} {group['pairs']:>5} {cells[0]:>15} {cells[1]:>15} {group['accepted_wrong']:>15}"


def _bound(group: Report) -> str:
    return "" if group["at_most"] is None else f"  (95 % bound of the rate: {group['at_most']:.2%})"


def _calibration_lines(calibrated: Report | None) -> list[str]:
    if calibrated is None:
        return ["no probabilities: the method gives none"]
    lines = [
        f"probability that the best pose is right: Brier score {calibrated['brier']:.4f}, {calibrated['pairs']} pairs"
    ]
    for fifth in calibrated["fifths"]:
        if fifth["pairs"]:
            told, right = f"mean {fifth['mean_probability']:.2f}", f"right {fifth['right']:.2f}"
            lines.append(f"  {fifth['from']:.1f} to {fifth['to']:.1f}   {told}   {right}   {fifth['pairs']} pairs")
    return lines
