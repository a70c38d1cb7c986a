"""Plots with axes and legends; the only file that imports matplotlib (extra `plots`)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster, known_corners, raster_around, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.errors import ToolError

FloatArray = NDArray[np.float64]
_COLORS = ("#1f6fb4", "#d9541e")
_BOTH = "#7a3fa0"
_FADED = 0.25  # free space in a quarter of its car's colour
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
    _draw_overlay(local, picture)
    for number, color in enumerate(_COLORS):
        _draw_drive(local, picture, number, color)
    local.plot([], [], "s", color=_BOTH, ms=10, label="seen by both: dark walls, light free space")
    local.set_title("two local maps in the global frame")
    local.legend(loc="upper right")
    _draw_fused(fused, picture)
    for axes in (local, fused):
        axes.set(xlabel="x in m", aspect="equal")
        axes.margins(0.0)
    local.set_ylabel("y in m")
    figure.suptitle(picture.title, fontsize=16)
    figure.savefig(file, dpi=100)
    plt.close(figure)


def overlay(picture: MissionPicture) -> tuple[FloatArray, Raster]:
    """Return the local maps over each other as an RGB image (rows, cols, 3) from 0 to 1, row 0 lowest, and its raster.

    Free space and walls of one car are in its colour, those of both in a third one, all else is white.
    """
    placed = list(zip(picture.grids, picture.T_global_map, strict=True))
    corners = np.vstack([se2.transform_points(T, known_corners(grid)) for grid, T in placed])
    raster = raster_around(corners, min(grid.resolution_m for grid in picture.grids))
    seen = [OccupancyGrid(resample(grid, T, raster), raster.resolution_m, raster.origin) for grid, T in placed]
    image = np.ones((*raster.shape, 3))
    for shade, masks in ((_FADED, [grid.free for grid in seen]), (1.0, [grid.occupied for grid in seen])):
        for mask, color in [*zip(masks, _COLORS, strict=True), (np.logical_and.reduce(masks), _BOTH)]:
            image[mask] = 1.0 - shade * (1.0 - _rgb(color))
    return image, raster


def _rgb(color: str) -> FloatArray:
    """Return "#rrggbb" as three numbers from 0 to 1."""
    return np.array([int(color[first : first + 2], 16) for first in (1, 3, 5)]) / 255.0


def _draw_overlay(axes: Any, picture: MissionPicture) -> None:
    image, raster = overlay(picture)
    axes.imshow(image, origin="lower", extent=_extent(raster), interpolation="nearest")


def _extent(raster: Raster) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top in m of a raster that lies upright."""
    (rows, cols), (x, y, _) = raster.shape, raster.origin.tolist()
    return x, x + cols * raster.resolution_m, y, y + rows * raster.resolution_m


def _draw_drive(axes: Any, picture: MissionPicture, number: int, color: str) -> None:
    """Draw where one car went, with a dot where it started."""
    drive = se2.compose(picture.T_global_map[number], picture.trajectories[number])
    axes.plot(drive[:, 0], drive[:, 1], color="white", lw=3.5)
    axes.plot(drive[:, 0], drive[:, 1], color=color, lw=1.8, label=f"{picture.names[number]}: map, drive, start")
    axes.plot(*drive[0, :2], "o", color=color, ms=10, mec="white")


def _draw_fused(axes: Any, picture: MissionPicture) -> None:
    grid = picture.fused
    extent = _extent(raster_of(grid))
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
