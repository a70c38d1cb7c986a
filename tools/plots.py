"""Plots with axes and legends; the only file that imports matplotlib (extra `plots`)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from tools.errors import ToolError

FloatArray = NDArray[np.float64]
_COLORS = ("#1f6fb4", "#d9541e")
_ARROW_EVERY_M = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class MissionPicture:
    """What the demo shows: per car name, grid, poses (N, 3) in its own frame and pose (3,) of that in the global one.

    path (N, 3) in the global frame, empty where there is none.
    """

    names: tuple[str, ...]
    grids: tuple[OccupancyGrid, ...]
    trajectories: tuple[FloatArray, ...]
    T_global_map: tuple[FloatArray, ...]
    fused: OccupancyGrid
    path: FloatArray
    title: str


def draw_mission(file: Path, picture: MissionPicture) -> None:
    """Write a PNG: left the local maps in their colours, laid over each other, right the global map with the path.

    Raises ToolError without matplotlib.
    """
    try:
        import matplotlib as mpl
    except ImportError as missing:
        raise ToolError("pictures with axes need matplotlib: pip install 'mapfuse-robot[plots]'") from missing
    logging.getLogger("matplotlib").setLevel(logging.WARNING)
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (local, fused) = plt.subplots(1, 2, figsize=(17, 8.5), layout="constrained", sharex=True, sharey=True)
    for number, color in enumerate(_COLORS):
        _draw_local(local, picture, number, color)
    local.set_title("two local maps in the global frame")
    local.legend(loc="upper right")
    _draw_fused(fused, picture)
    for axes in (local, fused):
        axes.set(xlabel="x in m", aspect="equal")
    local.set_ylabel("y in m")
    figure.suptitle(picture.title, fontsize=16)
    figure.savefig(file, dpi=100)
    plt.close(figure)


def _draw_local(axes: Any, picture: MissionPicture, number: int, color: str) -> None:
    """Draw one car's free space, walls and drive."""
    grid, T = picture.grids[number], picture.T_global_map[number]
    for mask, size, alpha in ((grid.free, 1.6, 0.12), (grid.occupied, 2.2, 1.0)):
        rows, cols = np.nonzero(mask)
        points = se2.transform_points(T, grid.cell_centers(rows, cols))
        axes.plot(points[:, 0], points[:, 1], "s", color=color, ms=size, alpha=alpha, mew=0, rasterized=True)
    drive = se2.compose(T, picture.trajectories[number])
    axes.plot(drive[:, 0], drive[:, 1], color="white", lw=3.5)
    axes.plot(drive[:, 0], drive[:, 1], color=color, lw=1.8, label=f"{picture.names[number]}: walls, drive, start")
    axes.plot(*drive[0, :2], "o", color=color, ms=10, mec="white")


def _draw_fused(axes: Any, picture: MissionPicture) -> None:
    grid = picture.fused
    rows, cols = grid.log_odds.shape
    x, y, _ = grid.origin
    extent = (x, x + cols * grid.resolution_m, y, y + rows * grid.resolution_m)
    shades = np.where(grid.known, 1.0 - grid.probability, 0.8)
    axes.imshow(shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    if len(picture.path) == 0:
        axes.set_title("global map; no path")
        return
    path = picture.path
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    marks = np.searchsorted(travelled, np.arange(0.0, travelled[-1], _ARROW_EVERY_M))
    axes.plot(path[:, 0], path[:, 1], color="tab:green", lw=2.5, label="planned path, heading of the car")
    heading = path[marks, 2]
    axes.quiver(
        path[marks, 0], path[marks, 1], np.cos(heading), np.sin(heading),
        color="tab:green", angles="xy", scale=28, width=0.006, zorder=3,
    )  # fmt: skip
    axes.plot(*path[0, :2], "o", color=_COLORS[0], ms=11, mec="white", label="start: where car A started")
    axes.plot(*path[-1, :2], "*", color=_COLORS[1], ms=17, mec="white", label="goal: where car B started")
    axes.set_title(f"global map and a path of {travelled[-1]:.1f} m")
    axes.legend(loc="upper right")
