"""Plots with axes and legends; the only file that imports matplotlib (extra `plots`)."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.metrics import TrajectoryError2D
from mapping.trajectory import Trajectory
from tools.errors import ToolError


def draw_demo(path: Path, grid: OccupancyGrid, mapped: Trajectory, truth: Trajectory, error: TrajectoryError2D) -> None:
    """Write a PNG of the map with the mapped trajectory, the truth in the map's frame, and the error over time."""
    try:
        import matplotlib as mpl
    except ImportError as missing:
        raise ToolError("pictures with axes need matplotlib: pip install 'mapfuse-robot[plots]'") from missing
    logging.getLogger("matplotlib").setLevel(logging.WARNING)
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    T_map_truth = se2.inverse(np.array(error.T_truth_estimate))
    true_path = se2.compose(T_map_truth, truth.poses)
    true_here = se2.compose(T_map_truth, truth.at(mapped.stamps_ns))
    figure, (map_axes, error_axes) = plt.subplots(2, 1, figsize=(11, 10), height_ratios=[4, 1], layout="constrained")
    rows, cols = grid.log_odds.shape
    x, y, _ = grid.origin
    extent = (x, x + cols * grid.resolution_m, y, y + rows * grid.resolution_m)
    shades = np.where(grid.known, 1.0 - grid.probability, 0.8)
    map_axes.imshow(shades, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    map_axes.plot(true_path[:, 0], true_path[:, 1], color="tab:blue", lw=4, alpha=0.45, label="truth (simulator)")
    map_axes.plot(mapped.poses[:, 0], mapped.poses[:, 1], color="tab:red", lw=1.3, label="mapped trajectory")
    map_axes.plot(*mapped.poses[0, :2], "o", color="tab:green", ms=8, label="start")
    map_axes.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    map_axes.set_title(f"Simulated drive through the office: {error.rms_m * 100:.1f} cm rms trajectory error")
    map_axes.legend(loc="lower right")
    seconds = (mapped.stamps_ns - mapped.stamps_ns[0]) * 1e-9
    distance = np.hypot(*(mapped.poses - true_here)[:, :2].T)
    error_axes.plot(seconds, distance * 100.0, color="tab:red", lw=1)
    error_axes.set(xlabel="time in s", ylabel="position error in cm", xlim=(0, seconds[-1]), ylim=(0, None))
    error_axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)
