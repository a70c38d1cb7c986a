"""Plots of merged maps, with axes: the occupied cells of several merges over each other (figure 5.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.plots import pyplot

FloatArray = NDArray[np.float64]
_PART_M = 5.0
_SPAN = np.array([0.0, _PART_M])
_COLORS = ("#222222", "#d9541e", "#1f6fb4", "#2a8c4a", "#7a3fa0")


@dataclass(frozen=True, slots=True, eq=False)
class MergedPoints:
    """What a merge is called, and the centres (N, 2) in m of its occupied cells; none where it was refused."""

    label: str
    points: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MergePanel:
    """The merges of one method."""

    title: str
    merges: Sequence[MergedPoints]


def draw_merged_points(file: Path, panels: Sequence[MergePanel]) -> None:
    """Write a PNG with two panels a method: the whole, and a part that has most walls, where merges can be told apart.

    The later a merge the smaller its dots, so that all show. Methods that merged nothing have no panels. Raises
    ToolError without matplotlib.
    """
    plt = pyplot()
    shown = [panel for panel in panels if any(len(each.points) for each in panel.merges)]
    everything = np.vstack([each.points for panel in shown for each in panel.merges] or [np.zeros((1, 2))])
    low, high = everything.min(axis=0) - 1.0, everything.max(axis=0) + 1.0
    corner = _busiest(everything)
    width, height = (high - low).tolist()
    panel_height = float(np.clip(5.0 * height / width, 2.5, 7.0))
    figure, axes = plt.subplots(
        2, max(len(shown), 1), squeeze=False, layout="constrained", height_ratios=[panel_height, 5.0],
        figsize=(5.2 * max(len(shown), 1), panel_height + 6.6),
    )  # fmt: skip
    for column, panel in zip(axes.T, shown, strict=False):
        for axis, dot in zip(column, (2.0, 60.0), strict=True):
            _draw_merges(axis, panel, dot)
        column[0].set(title=panel.title, aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        column[0].add_patch(plt.Rectangle(corner, _PART_M, _PART_M, fill=False, color="#2a8c4a", lw=1.5))
        column[1].set(xlabel="x in m", aspect="equal", xlim=corner[0] + _SPAN, ylim=corner[1] + _SPAN)
        column[1].set_title(f"the {_PART_M:g} m marked green", fontsize=9)
        legend = column[1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False)
        for handle in legend.legend_handles:
            handle.set_sizes([50.0])
    if not shown:
        axes[0, 0].text(0.5, 0.5, "every merge was refused", ha="center")
    for axis in axes[:, 0]:
        axis.set_ylabel("y in m")
    figure.savefig(file, dpi=80)
    plt.close(figure)


def _draw_merges(axis: Any, panel: MergePanel, dot: float) -> None:
    """Draw all merges, each with dots of a third of the area of the one before."""
    for number, merge in enumerate(panel.merges):
        color = _COLORS[number % len(_COLORS)] if len(merge.points) else "#bbbbbb"
        axis.scatter(*merge.points.T, s=dot / 3.0**number, c=color, marker="s", lw=0, label=merge.label)
    axis.grid(visible=True, alpha=0.2)


def _busiest(points: FloatArray) -> FloatArray:
    """Return the lower-left corner (2,) of the square of _PART_M, on a lattice, with the most points (N, 2)."""
    squares, counts = np.unique(np.floor(points / _PART_M), axis=0, return_counts=True)
    return np.asarray(squares[int(np.argmax(counts))] * _PART_M)
