"""Plot of two growing maps: what their registration says at each step, and when they are merged (figure 5.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusion.readiness import ReadinessRule
from tools.growing_steps import StepOutcome, merged_from
from tools.plots import pyplot
from tools.results import Report

_TUNED, _THESIS, _DEFAULT = "#1f6fb4", "#8a8a8a", "#222222"
_RIGHT, _WRONG, _MERGED, _ENOUGH = "#2a8c4a", "#c81e1e", "#e3f2e6", "#7a3fa0"
_LEAST_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class GrowingPicture:
    """What is drawn: the rows of growing_steps.step_row, and what follows from them.

    verdicts: by way, whether each step's verdict merges rightly, None where it refuses. settled: how the default method
    and its rule stand after each step. enough: number of the step from which the maps share enough, None: never.
    """

    title: str
    rows: Sequence[Report]
    verdicts: Mapping[str, Sequence[bool | None]]
    settled: Sequence[StepOutcome]
    enough: int | None


def draw_growing(file: Path, picture: GrowingPicture) -> None:
    """Write a PNG of panels over the steps: Algorithm 3's where it was run, and the default method's.

    Raises ToolError without matplotlib.
    """
    rows, settled, enough = picture.rows, picture.settled, picture.enough
    plt = pyplot()
    steps = np.arange(1, len(rows) + 1)
    panels = 5 if "algorithm3" in picture.verdicts else 3
    figure, axes = plt.subplots(panels, 1, figsize=(8.5, 1.2 + 1.75 * panels), sharex=True, layout="constrained")
    if panels > 3:
        _draw_algorithm3(axes[0], axes[1], steps, picture)
    _draw_probability(axes[-3], steps, picture)
    _draw_wall(axes[-2], steps, picture)
    _draw_motion(axes[-1], steps, settled)
    first = merged_from(settled)
    for axis in axes:
        _shade(axis, steps, settled)
        if enough is not None:
            axis.axvline(enough + 1, color=_ENOUGH, ls="--", lw=1.4)
        if first is not None:
            axis.axvline(first + 1, color=_RIGHT, lw=1.6)
        axis.grid(visible=True, alpha=0.25)
    axes[-1].set_xlabel("step; each robot drives on between two")
    axes[-1].set_xlim(0.5, len(rows) + 0.5)
    shown = {
        "in truth enough in common": None if enough is None else {"color": _ENOUGH, "ls": "--"},
        "merged (green ground: while merged)": None if first is None else {"color": _RIGHT},
        "this verdict alone would merge, rightly": {"color": _RIGHT, "marker": "o", "ls": "none"},
        "the same, wrongly": {"color": _WRONG, "marker": "X", "ls": "none"},
    }
    handles = [plt.Line2D([], [], label=label, **style) for label, style in shown.items() if style is not None]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    figure.suptitle(picture.title, fontsize=12)
    figure.savefig(file, dpi=80)
    plt.close(figure)


def _draw_algorithm3(inliers: Any, acceptance: Any, steps: Any, picture: GrowingPicture) -> None:
    """Draw figure 5.4: the inliers and the acceptance index of Algorithm 3, by the thesis's and by other settings."""
    for way, color, label in (
        ("algorithm3", _TUNED, "Algorithm 3: alpha 0.5, ratio 0.8, 3 px, 5000 trials"),
        ("thesis", _THESIS, "Algorithm 3: the thesis's settings"),
    ):
        counts = np.array([row[way]["inliers"] or 0 for row in picture.rows])
        indices = np.array([row[way]["acceptance"] for row in picture.rows])
        inliers.plot(steps, counts, "-", color=color, lw=1.3, label=label)
        acceptance.plot(steps, indices, "-", color=color, lw=1.3)
        _mark(inliers, steps, counts, picture.verdicts[way])
        _mark(acceptance, steps, indices, picture.verdicts[way])
    inliers.set(ylabel="inliers", ylim=(0, None))
    inliers.legend(loc="upper left", fontsize=8, frameon=False)
    acceptance.set(ylabel="acceptance\nindex ω", ylim=(-0.03, 1.05))


def _draw_probability(axis: Any, steps: Any, picture: GrowingPicture) -> None:
    values = np.array([row["default"]["probability"] or 0.0 for row in picture.rows])
    axis.plot(steps, values, "-", color=_DEFAULT, lw=1.3)
    _mark(axis, steps, values, picture.verdicts["default"])
    axis.set(ylabel="default method:\nprobability", ylim=(-0.03, 1.05))


def _draw_wall(axis: Any, steps: Any, picture: GrowingPicture) -> None:
    """Draw the wall that agrees and contradicts at the pose found, and what is common in truth."""
    for key, color, label in (("common_wall_m", _DEFAULT, "agrees"), ("conflict_m", _WRONG, "contradicts")):
        lengths_m = [row["default"][key] or 0.0 for row in picture.rows]
        axis.plot(steps, lengths_m, "-", color=color, lw=1.3, label=label)
    if picture.enough is not None:
        in_truth_m = [row["common_wall_m"] for row in picture.rows]
        axis.plot(steps, in_truth_m, "--", color=_ENOUGH, lw=1.1, label="in common in truth")
    axis.set(ylabel="default method:\nwall, m", ylim=(0, None))
    axis.legend(loc="upper left", fontsize=8, frameon=False)


def _draw_motion(axis: Any, steps: Any, settled: Sequence[StepOutcome]) -> None:
    moved = np.array([step.moved_m for step in settled])
    shown = np.isfinite(moved)
    axis.semilogy(steps[shown], np.maximum(moved[shown], _LEAST_M), "-", color=_DEFAULT, lw=1.3)
    axis.axhline(ReadinessRule().moved_m, color=_DEFAULT, lw=0.9, ls=":", label="limit")
    axis.legend(loc="upper right", fontsize=8, frameon=False)
    axis.set_ylabel("default method:\npose moved, m")


def _mark(axis: Any, steps: Any, values: Any, verdicts: Sequence[bool | None]) -> None:
    """Mark the steps at which a verdict accepts: rightly (True) or wrongly (False)."""
    for wanted, marker, color in ((True, "o", _RIGHT), (False, "X", _WRONG)):
        chosen = np.array([verdict is wanted for verdict in verdicts])
        axis.plot(steps[chosen], values[chosen], marker, color=color, ms=5 if wanted else 7, ls="none", zorder=3)


def _shade(axis: Any, steps: Any, settled: Sequence[StepOutcome]) -> None:
    for step, outcome in zip(steps.tolist(), settled, strict=True):
        if outcome.merged:
            axis.axvspan(step, step + 1, color=_MERGED, lw=0, zorder=0)
