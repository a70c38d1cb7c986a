"""Plots with axes and legends; the only file that imports matplotlib (extra `plots`)."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster, known_corners, raster_around, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.errors import ToolError
from tools.feature_study import FeatureTrial
from tools.rate_study import RateMap

FloatArray = NDArray[np.float64]
_COLORS = ("#1f6fb4", "#d9541e")
_BOTH = "#7a3fa0"
_FADED = 0.25  # free space in a quarter of its car's colour
_ARROW_EVERY_M = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMaps:
    """Two cars' maps: name, grid, poses (N, 3) in its own frame and pose (3,) of that in the common one; a title."""

    names: tuple[str, ...]
    grids: tuple[OccupancyGrid, ...]
    trajectories: tuple[FloatArray, ...]
    T_global_map: tuple[FloatArray, ...]
    title: str


@dataclass(frozen=True, slots=True, eq=False)
class MissionPicture:
    """What the demo shows: two lidar maps, the global map, and in it a path (N, 3) and how it was driven (M, 3).

    Either is empty where there is none. camera: a lidar map and a camera map, in the lidar map's frame.
    """

    local: PlacedMaps
    fused: OccupancyGrid
    path: FloatArray
    driven: FloatArray
    camera: PlacedMaps
    title: str


def draw_mission(file: Path, picture: MissionPicture) -> None:
    """Write a PNG of three parts: the lidars' maps over each other, the global map with the path, camera and lidar.

    Raises ToolError without matplotlib.
    """
    plt = pyplot()
    figure, (local, fused, camera) = plt.subplots(1, 3, figsize=(22, 8), layout="constrained")
    fused.sharex(local)
    fused.sharey(local)
    _draw_placed(local, picture.local)
    _draw_fused(fused, picture)
    _draw_placed(camera, picture.camera)
    for axes in (local, fused, camera):
        axes.set(xlabel="x in m", aspect="equal")
        axes.margins(0.0)
    local.set_ylabel("y in m")
    figure.suptitle(picture.title, fontsize=16)
    figure.savefig(file, dpi=100)
    plt.close(figure)


def _draw_placed(axes: Any, maps: PlacedMaps) -> None:
    """Draw two maps over each other with the drives and what the colours mean."""
    _draw_overlay(axes, maps)
    for number, color in enumerate(_COLORS):
        _draw_drive(axes, maps, number, color)
    axes.plot([], [], "s", color=_BOTH, ms=10, label="seen by both: dark walls, light free space")
    axes.set_title(maps.title)
    _legend_below(axes)


def _legend_below(axes: Any) -> None:
    """Add the legend under the axes: a map may fill all of them."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=1, frameon=False)


def overlay(maps: PlacedMaps) -> tuple[FloatArray, Raster]:
    """Return the local maps over each other as an RGB image (rows, cols, 3) from 0 to 1, row 0 lowest, and its raster.

    Free space and walls of one car are in its colour, those of both in a third one, all else is white.
    """
    placed = list(zip(maps.grids, maps.T_global_map, strict=True))
    corners = np.vstack([se2.transform_points(T, known_corners(grid)) for grid, T in placed])
    raster = raster_around(corners, min(grid.resolution_m for grid in maps.grids))
    seen = [OccupancyGrid(resample(grid, T, raster), raster.resolution_m, raster.origin) for grid, T in placed]
    image = np.ones((*raster.shape, 3))
    for shade, masks in ((_FADED, [grid.free for grid in seen]), (1.0, [grid.occupied for grid in seen])):
        for mask, color in [*zip(masks, _COLORS, strict=True), (np.logical_and.reduce(masks), _BOTH)]:
            image[mask] = 1.0 - shade * (1.0 - _rgb(color))
    return image, raster


def _rgb(color: str) -> FloatArray:
    """Return "#rrggbb" as three numbers from 0 to 1."""
    return np.array([int(color[first : first + 2], 16) for first in (1, 3, 5)]) / 255.0


def _draw_overlay(axes: Any, maps: PlacedMaps) -> None:
    image, raster = overlay(maps)
    axes.imshow(image, origin="lower", extent=_extent(raster), interpolation="nearest")


def _extent(raster: Raster) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top in m of a raster that lies upright."""
    (rows, cols), (x, y, _) = raster.shape, raster.origin.tolist()
    return x, x + cols * raster.resolution_m, y, y + rows * raster.resolution_m


def _draw_drive(axes: Any, maps: PlacedMaps, number: int, color: str) -> None:
    """Draw where one car went, with a dot where it started."""
    drive = se2.compose(maps.T_global_map[number], maps.trajectories[number])
    axes.plot(drive[:, 0], drive[:, 1], color="white", lw=3.5)
    axes.plot(drive[:, 0], drive[:, 1], color=color, lw=1.8, label=f"{maps.names[number]}: map, drive, start")
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
    if len(picture.driven):
        driven = picture.driven
        axes.plot(driven[:, 0], driven[:, 1], color="black", lw=2.0, ls=":", zorder=4, label="car A's drive (truth)")
    axes.plot(*path[0, :2], "o", color=_COLORS[0], ms=11, mec="white", label="start: where car A stands")
    axes.plot(*path[-1, :2], "*", color=_COLORS[1], ms=17, mec="white", label="goal: where car B started")
    axes.set_title(f"global map and a path of {travelled[-1]:.1f} m")
    _legend_below(axes)


_FAILED = "#c81e1e"
_RATE_COLORS = ("#1f6fb4", "#d9541e", "#2a8c4a", "#7a3fa0", "#8a6d1a", "#3aa6a6", "#b0457b")


def draw_rate_maps(file: Path, maps: Sequence[RateMap], title: str) -> None:
    """Write a PNG of the maps with their pose graphs, a row for each rate and a column for each resolution (fig. 4.2).

    Failed ones are framed in red and say why. Raises ToolError without matplotlib.
    """
    plt = pyplot()
    rates, resolutions = _axes_of(maps)
    height, width = (max(each.map_size[axis] / each.cells_per_meter for each in maps) for axis in (0, 1))
    tile_height = 3.4 * min(max(height / width, 0.35), 1.6)
    figure, axes = plt.subplots(
        len(rates), len(resolutions), squeeze=False, layout="constrained",
        figsize=(3.4 * len(resolutions) + 0.6, (tile_height + 0.75) * len(rates) + 0.7),
    )  # fmt: skip
    for each in maps:
        row, col = rates.index(each.scan_every), resolutions.index(each.cells_per_meter)
        _draw_rate_map(axes[row, col], each)
        if col == 0:
            axes[row, col].set_ylabel(_rate_name(each), fontsize=12)
    figure.suptitle(title, fontsize=14)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_real_time_factors(file: Path, maps: Sequence[RateMap], title: str) -> None:
    """Write a PNG of time to map over duration, by r, a line for each rate; failed maps are red crosses (fig. 4.1).

    Raises ToolError without matplotlib.
    """
    plt = pyplot()
    rates, resolutions = _axes_of(maps)
    figure, axes = plt.subplots(figsize=(8.5, 5.2), layout="constrained")
    for number, scan_every in enumerate(rates):
        mine = sorted((each for each in maps if each.scan_every == scan_every), key=lambda each: each.cells_per_meter)
        color = _RATE_COLORS[number % len(_RATE_COLORS)]
        r, tau = [each.cells_per_meter for each in mine], [each.tau for each in mine]
        axes.plot(r, tau, "o-", color=color, lw=1.8, ms=5, label=_rate_name(mine[0]).replace("\n", ", "))
        failed = [each for each in mine if each.failures]
        axes.plot(
            [each.cells_per_meter for each in failed], [each.tau for each in failed], "x", color=_FAILED, ms=12, mew=2.5
        )
    if any(each.failures for each in maps):
        axes.plot([], [], "x", color=_FAILED, ms=10, mew=2.5, ls="none", label="the map failed")
    axes.set(xlabel="r in cells/m", ylabel="τ = CPU time to map / duration of the data")
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(resolutions, [f"{r:g}" for r in resolutions])
    axes.grid(visible=True, alpha=0.25)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    axes.set_title(title, fontsize=12)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_inliers(file: Path, trials: Sequence[FeatureTrial], title: str) -> None:
    """Write a PNG: the inliers of each kind of features over alpha (thesis fig. 3.5b).

    Raises ToolError without matplotlib.
    """
    plt = pyplot()
    figure, axes = plt.subplots(figsize=(9, 6), layout="constrained")
    for features in dict.fromkeys(trial.features for trial in trials):
        own = [trial for trial in trials if trial.features == features]
        axes.plot([trial.alpha for trial in own], [trial.inliers for trial in own], "o-", label=features)
    axes.set(xlabel="alpha (0: the map as it is)", ylabel="inliers", title=title, ylim=(0, None))
    axes.legend()
    figure.savefig(file, dpi=110)
    plt.close(figure)


def pyplot() -> Any:
    """Return matplotlib's pyplot, drawing to files; raise ToolError where it is not installed."""
    try:
        import matplotlib as mpl
    except ImportError as missing:
        raise ToolError("pictures with axes need matplotlib: pip install 'mapfuse-robot[plots]'") from missing
    logging.getLogger("matplotlib").setLevel(logging.WARNING)
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def _axes_of(maps: Sequence[RateMap]) -> tuple[list[int], list[float]]:
    """Return the rates (every k-th scan) and the resolutions in cells/m, rising."""
    return sorted({each.scan_every for each in maps}), sorted({each.cells_per_meter for each in maps})


def _rate_name(each: RateMap) -> str:
    share = "every scan" if each.scan_every == 1 else f"one scan in {each.scan_every}"
    return f"T ≈ {each.rate_hz:.2f} Hz\n{share}"


def _draw_rate_map(axes: Any, each: RateMap) -> None:
    """Draw one map, pale, with steps (blue), closures (orange) and keyframes (dots)."""
    extent = _extent(raster_of(each.grid))
    shades = np.where(each.grid.known, 1.0 - 0.75 * each.grid.probability, 0.82)
    axes.imshow(shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    poses = each.graph.poses
    for edges, color, width in ((each.graph.closures, "#f08a1e", 0.5), (each.graph.steps, "#1f5fb4", 0.5)):
        ends = poses[edges]
        line = np.full((len(edges), 3, 2), np.nan)
        line[:, :2] = ends[:, :, :2]
        axes.plot(line[:, :, 0].ravel(), line[:, :, 1].ravel(), color=color, lw=width)
    axes.plot(poses[:, 0], poses[:, 1], ".", color="#1f5fb4", ms=1.0)
    axes.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])
    rows, cols = each.map_size
    error = "" if each.error_m is None else f", error {each.error_m:.3f} m"
    text = f"r = {each.cells_per_meter:g}, {rows}×{cols} cells, {each.scans} scans\nτ = {each.tau:.4f}{error}"
    if each.failures:
        text += "\nFAILED: " + _wrapped(each.failures)
        for spine in axes.spines.values():
            spine.set(color=_FAILED, linewidth=3)
    axes.set_title(text, fontsize=9, color=_FAILED if each.failures else "black")


def _wrapped(reasons: Sequence[str]) -> str:
    """Return reasons, two a line at most."""
    return ",\n".join(", ".join(reasons[first : first + 2]) for first in range(0, len(reasons), 2))
