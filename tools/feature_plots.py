"""Plots of chapter 4's experiments: panels of lines, and matrices as heat maps with their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.plots import pyplot

FloatArray = NDArray[np.float64]
_COLORS = ("#1f6fb4", "#d9541e", "#2a8c4a", "#7a3fa0", "#8a6d1a", "#3aa6a6", "#b0457b")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_DPI = 100
_WIDE = 30.0  # the factor from which on values are drawn on a logarithmic axis
_LIGHT = 0.55  # of the range of a heat map, up to which numbers are black


@dataclass(frozen=True, slots=True)
class Line:
    """A line through points; a y that is nan leaves a gap."""

    label: str
    x: Sequence[float]
    y: Sequence[float]


@dataclass(frozen=True, slots=True)
class Panel:
    """Lines with one pair of axes; log: of y, where its values differ by much. most: the end of y.

    ticks: names of the places on x, where these are no numbers.
    """

    title: str
    lines: Sequence[Line]
    x_label: str
    y_label: str
    log: bool = False
    ticks: Sequence[str] | None = None
    most: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class HeatMap:
    """A matrix (rows, cols), row 0 at the top, nan where there is no value; its texts; the range of its colours."""

    title: str
    values: FloatArray
    texts: Sequence[Sequence[str]]
    most: float


def draw_panels(file: Path, panels: Sequence[Panel], columns: int, title: str) -> None:
    """Write a PNG of panels whose lines have the same labels, told once below them; ToolError without matplotlib."""
    plt = pyplot()
    rows = -(-len(panels) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.1 * columns, 3.2 * rows + 0.9), squeeze=False, layout="constrained"
    )
    for axis, panel in zip(axes.flat, panels, strict=False):
        _draw_panel(axis, panel)
    for axis in axes.flat[len(panels) :]:
        axis.set_axis_off()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), frameon=False)
    figure.suptitle(title, fontsize=13)
    figure.savefig(file, dpi=_DPI)
    plt.close(figure)


def draw_heat_maps(
    file: Path, maps: Sequence[HeatMap], columns: int, ticks: Sequence[str], labels: tuple[str, str], title: str
) -> None:
    """Write a PNG of square matrices with numbers; ticks name rows and columns; labels: of x and y."""
    plt = pyplot()
    rows = -(-len(maps) // columns)
    side = max(3.0, 0.52 * len(ticks) + 0.8)
    figure, axes = plt.subplots(
        rows, columns, figsize=(side * columns, side * rows + 0.5), squeeze=False, layout="constrained"
    )
    for axis, each in zip(axes.flat, maps, strict=False):
        _draw_heat_map(axis, each, ticks)
    for axis in axes.flat[len(maps) :]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel(labels[0])
    for axis in axes[:, 0]:
        axis.set_ylabel(labels[1])
    figure.suptitle(title, fontsize=13)
    figure.savefig(file, dpi=_DPI)
    plt.close(figure)


def _draw_panel(axis: Any, panel: Panel) -> None:
    for number, line in enumerate(panel.lines):
        style = {"color": _COLORS[number % len(_COLORS)], "marker": _MARKERS[number % len(_MARKERS)]}
        axis.plot(line.x, line.y, label=line.label, lw=1.6, ms=5, **style)
    axis.set(xlabel=panel.x_label, ylabel=panel.y_label)
    axis.set_title(panel.title, fontsize=11)
    axis.grid(visible=True, alpha=0.25)
    places = sorted({x for line in panel.lines for x in line.x})
    axis.set_xticks(places, panel.ticks or [f"{x:g}" for x in places])
    values = np.array([y for line in panel.lines for y in line.y], np.float64)
    positive = values[values > 0.0]
    if panel.log and panel.most is None and len(positive) and positive.max() > _WIDE * positive.min():
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
    else:
        axis.set_ylim(0.0, panel.most or 1.08 * float(np.nanmax([0.0, *values])) or 1.0)


def _draw_heat_map(axis: Any, each: HeatMap, ticks: Sequence[str]) -> None:
    axis.imshow(each.values, cmap="YlGnBu", vmin=0.0, vmax=each.most)
    for (row, col), value in np.ndenumerate(each.values):
        dark = np.isfinite(value) and value > _LIGHT * each.most
        axis.text(
            col, row, each.texts[row][col], ha="center", va="center", fontsize=9, color="white" if dark else "black"
        )
    axis.set_xticks(range(len(ticks)), ticks)
    axis.set_yticks(range(len(ticks)), ticks)
    axis.set_title(each.title, fontsize=11)
