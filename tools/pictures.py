"""Pictures of a map, drawn with OpenCV: always available, also on the car."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.graph_slam import PoseGraph
from mapping.grid import LogOdds, OccupancyGrid
from mapping.trajectory import Trajectory

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_UNKNOWN_GRAY = 205
_LEAST_FREE_GRAY, _LEAST_WALL_GRAY, _PALE_WALL_GRAY = 225, 185, 145
_MARGIN_CELLS = 6
_MOST_ROOM_CELLS = 4000
_LONG_SIDE_PX = 1200
_PATH_BGR = (60, 60, 220)
_START_BGR = (60, 160, 40)
_STEP_BGR = (170, 90, 30)
_CLOSURE_BGR = (30, 130, 240)
_INK_BGR = (40, 40, 40)


def draw_map(grid: OccupancyGrid, trajectory: Trajectory | None = None) -> Image:
    """Return a BGR picture (H, W, 3): walls dark, free white, y up, the path red with a green dot at its start."""
    path = np.zeros((0, 2)) if trajectory is None else trajectory.poses[:, :2]
    image, pixels, scale = drawn_cells(grid, path, darkest=0)
    if len(pixels):
        shifted = np.round(pixels * 16).astype(np.int32)  # 4 fractional bits
        cv2.polylines(image, [shifted], False, _PATH_BGR, min(scale, 2), cv2.LINE_AA, 4)
        start_x, start_y = pixels[0].round().astype(int).tolist()
        cv2.circle(image, (start_x, start_y), 6, _START_BGR, cv2.FILLED, cv2.LINE_AA)
    return with_scale_bar(image, scale / grid.resolution_m)


def draw_pose_graph(grid: OccupancyGrid, graph: PoseGraph) -> Image:
    """Return the map, pale, with the keyframes (dots), the front end's steps (blue) and loop closures (orange)."""
    image, pixels, scale = drawn_cells(grid, graph.poses[:, :2], darkest=_PALE_WALL_GRAY)
    shifted = np.round(pixels * 16).astype(np.int32)
    for edges, color, width in ((graph.closures, _CLOSURE_BGR, 1), (graph.steps, _STEP_BGR, 1)):
        for first, second in edges.tolist():
            cv2.line(image, shifted[first].tolist(), shifted[second].tolist(), color, width, cv2.LINE_AA, 4)
    for x, y in shifted.tolist():
        cv2.circle(image, (x, y), 16 * 2, _STEP_BGR, cv2.FILLED, cv2.LINE_AA, 4)
    return with_scale_bar(image, scale / grid.resolution_m)


def cell_shades(log_odds: LogOdds, darkest: int = 0) -> Image:
    """Return the gray of cells: unknown as a map_server has it, whatever is free lighter, whatever is a wall darker."""
    probability = 1.0 / (1.0 + np.exp(-log_odds.astype(np.float64)))
    free = _LEAST_FREE_GRAY + (255 - _LEAST_FREE_GRAY) * (1.0 - 2.0 * probability)
    wall = _LEAST_WALL_GRAY - (_LEAST_WALL_GRAY - darkest) * (2.0 * probability - 1.0)
    shades = np.where(log_odds == 0.0, _UNKNOWN_GRAY, np.where(probability < 0.5, free, wall))
    return np.asarray(np.round(shades), dtype=np.uint8)


def drawn_cells(grid: OccupancyGrid, points: FloatArray, darkest: int) -> tuple[Image, FloatArray, int]:
    """Return the map with room for points (N, 2) of its frame, enlarged, their pixels (N, 2), and pixels a cell.

    darkest: the gray of a sure wall.
    """
    rows, cols = grid.log_odds.shape
    cells = grid.cell_coordinates(points)
    reach = np.vstack([cells, [[0.0, 0.0], [cols, rows]]])
    outside = np.maximum(-reach.min(axis=0), reach.max(axis=0) - (cols, rows)).max() > 0.0
    margin = _MARGIN_CELLS if outside else 0
    left, below = np.clip(np.ceil(-reach.min(axis=0)).astype(int) + margin, 0, _MOST_ROOM_CELLS).tolist()
    beyond = np.ceil(reach.max(axis=0)).astype(int) - (cols, rows) + margin
    right, above = np.clip(beyond, 0, _MOST_ROOM_CELLS).tolist()
    roomy = np.pad(grid.log_odds, ((below, above), (left, right)))
    scale = max(1, round(_LONG_SIDE_PX / max(roomy.shape)))
    upright = np.ascontiguousarray(np.flipud(cell_shades(roomy, darkest)))
    enlarged = cv2.resize(upright, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    image = np.asarray(cv2.cvtColor(enlarged, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    pixels = np.column_stack([cells[:, 0] + left, roomy.shape[0] - below - cells[:, 1]]) * scale
    return image, pixels, scale


def write_picture(path: Path, image: Image) -> None:
    """Write the picture as PNG, whole or not at all; raise OSError if that fails."""
    encoded, data = cv2.imencode(".png", image)
    if not encoded:
        raise OSError(f"{path}: the picture could not be encoded")
    partial = path.with_name(f".{path.name}.part")
    partial.write_bytes(data.tobytes())
    partial.replace(path)


def with_scale_bar(image: Image, pixels_per_m: float) -> Image:
    """Return the picture with a strip below it that holds a bar of a round length."""
    lengths_m = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200]
    length_m = max([m for m in lengths_m if m * pixels_per_m <= image.shape[1] / 3] or lengths_m[:1])
    strip = np.full((40, image.shape[1], 3), 255, np.uint8)
    end = 12 + round(length_m * pixels_per_m)
    cv2.line(strip, (12, 20), (end, 20), _INK_BGR, 3)
    cv2.putText(strip, f"{length_m:g} m", (end + 10, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.6, _INK_BGR, 1, cv2.LINE_AA)
    return np.vstack([image, strip])
