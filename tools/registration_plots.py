"""Plots of a registration's evaluation: success by group, reliability of the probability, scores of right and wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tools.plots import pyplot
from tools.results import Report

_GROUPS = (
    ("by_band", "free space in common, lidar"),
    ("by_kind", "kind of the pair"),
    ("by_common_wall", "wall in common, warped maps apart"),
    ("by_building", "building"),
)
_ALIGNED, _MERGED, _WRONG = "#a9c8e6", "#1f6fb4", "#c81e1e"
_SCORES: tuple[tuple[str, str, Callable[[Report], bool]], ...] = (
    ("best pose right", _MERGED, lambda row: row["aligned"]),
    ("true pair, misaligned", "#e08a1e", lambda row: row["true"] and not row["aligned"]),
    ("wrong pair", _WRONG, lambda row: not row["true"]),
)


def draw_success(file: Path, report: Report) -> None:
    """Write a PNG of the shares of aligned and rightly accepted pairs in each group; ToolError without matplotlib."""
    plt = pyplot()
    shown = [(key, title) for key, title in _GROUPS if report[key]]
    figure, axes = plt.subplots(1, max(len(shown), 1), figsize=(4.4 * max(len(shown), 2), 4.6), squeeze=False)
    for (key, title), axis in zip(shown, axes[0], strict=False):
        _draw_bars(axis, report[key])
        axis.set_title(title, fontsize=11)
    axes[0, 0].set_ylabel("share of the true pairs")
    if shown:
        axes[0, 0].legend(loc="lower left", fontsize=8)
    else:
        axes[0, 0].text(0.5, 0.5, "no true pairs", ha="center")
    false, true = report["false_merges"]["all"], report["true_pairs"]
    figure.suptitle(
        f"registration: {true['aligned']} of {true['pairs']} true pairs aligned; accepted wrongly: "
        f"{true['accepted_wrong']} of them, {false['accepted']} of {false['pairs']} wrong pairs"
    )
    figure.tight_layout()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_reliability(file: Path, report: Report) -> None:
    """Write a PNG of the share that is right over the probability told, by fifths; ToolError without matplotlib."""
    plt = pyplot()
    figure, axis = plt.subplots(figsize=(5.4, 5.2), layout="constrained")
    calibrated = report["calibration"]
    axis.plot([0, 1], [0, 1], color="0.7", lw=1, label="true to its word")
    if calibrated is None:
        axis.text(0.5, 0.5, "the method gives no probability", ha="center")
    else:
        fifths = [fifth for fifth in calibrated["fifths"] if fifth["pairs"]]
        told, right, pairs = (np.array([f[key] for f in fifths]) for key in ("mean_probability", "right", "pairs"))
        error = 1.96 * np.sqrt(np.maximum(right * (1 - right), 0.25 / pairs) / pairs)
        axis.errorbar(told, right, error, fmt="o-", color=_MERGED, capsize=3, label="fifths, with 95 % bars")
        for x, y, n in zip(told, right, pairs, strict=True):
            axis.annotate(f"{n}", (x, y), xytext=(6, -12), textcoords="offset points", fontsize=9)
        axis.set_title(f"Brier score {calibrated['brier']:.3f}, {calibrated['pairs']} pairs", fontsize=11)
    axis.set(xlabel="probability told", ylabel="share that is right", xlim=(0, 1), ylim=(-0.03, 1.03))
    axis.legend(loc="upper left", frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_scores(file: Path, report: Report, rows: Sequence[Report]) -> None:
    """Write a PNG of how probability, else omega, tells right from wrong poses; ToolError without matplotlib."""
    plt = pyplot()
    groups = [(name, color, [row for row in rows if fits(row)]) for name, color, fits in _SCORES]
    shown = [group for group in groups if group[2]]
    size = (7.5, 0.5 + 2.0 * max(len(shown), 1))
    figure, axes = plt.subplots(max(len(shown), 1), 1, figsize=size, sharex=True, squeeze=False, layout="constrained")
    key = "acceptance" if report["calibration"] is None else "probability"
    edges = np.linspace(0.0, 1.0, 41)
    for axis, (name, color, mine) in zip(axes[:, 0], shown, strict=False):
        for accepted, alpha in ((False, 0.35), (True, 1.0)):
            values = [row[key] or 0.0 for row in mine if row["accepted"] is accepted]
            if values:
                axis.hist(values, edges, color=color, alpha=alpha, label="accepted" if accepted else "refused")
        axis.set_yscale("symlog", linthresh=10)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_ylabel("pairs")
        axis.set_title(f"{name}: {len(mine)}", fontsize=10)
        axis.legend(loc="upper center", fontsize=8)
    axes[-1, 0].set_xlabel("probability" if key == "probability" else "acceptance index")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _draw_bars(axis: Any, groups: Report) -> None:
    names = list(groups)
    pairs, aligned, merged, wrong = (
        np.array([groups[name][key] for name in names])
        for key in ("pairs", "aligned", "accepted_right", "accepted_wrong")
    )
    at = np.arange(len(names))
    axis.bar(at, aligned / pairs, color=_ALIGNED, label="aligned")
    axis.bar(at, merged / pairs, color=_MERGED, width=0.5, label="and accepted")
    axis.bar(at, wrong / pairs, color=_WRONG, width=0.2, label="accepted, but wrong")
    for x, share, n in zip(at, aligned / pairs, pairs, strict=True):
        axis.annotate(f"{share:.0%}\nof {n}", (x, share), ha="center", va="bottom", fontsize=8)
    axis.set_xticks(at, names, rotation=30, ha="right")
    axis.set_ylim(0, 1.18)
