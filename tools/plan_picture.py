"""The picture of a plan: the part of the map that matters, the car at both ends, the way coloured by gear, a legend."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.path import Path
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.lettering import fitted, text_width_px, write_text
from tools.pictures import Image, cell_shades, with_scale_bar

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]

_LONG_SIDE_PX, _LEAST_WIDTH_PX = 1200, 640
_ROOM_M, _ROOM_SHARE = 1.5, 0.1  # around what is shown: at least so much, and of its size
_FAR_OUTSIDE_M = 10.0  # an end this far off the map is not shown
_OUTLINE_EVERY_M = 0.5
_PALE_WALL_GRAY = 60
_START_BGR, _GOAL_BGR, _ADVICE_BGR = (60, 160, 40), (60, 60, 220), (170, 60, 150)
_FORWARD_BGR, _BACKWARD_BGR, _SWEPT_BGR = (190, 110, 20), (20, 130, 240), (200, 190, 170)
_INK_BGR, _WHITE_BGR = (40, 40, 40), (255, 255, 255)
_FRACTION = 4  # bits of OpenCV's coordinates
_FAR = 1 << 26  # in those; farther points are not drawn


def draw_plan(grid: OccupancyGrid, start: FloatArray, goal: FloatArray, result: PlanResult, vehicle: Vehicle) -> Image:
    """Return a BGR picture (H, W, 3) in the axes of the cells, y up; poses (3,) in the map frame."""
    ends = [(start, _START_BGR), (goal, _GOAL_BGR)]
    if result.advice is not None:
        ends.append((result.advice, _ADVICE_BGR))
    way = result.path.poses if result.path else np.empty((0, 3))
    image, to_pixels, pixels_per_m = _canvas(grid, np.vstack([*(pose for pose, _ in ends), way]), vehicle)
    if result.path is not None:
        _draw_path(image, result.path, vehicle, to_pixels)
    for pose, color in ends:
        _draw_car(image, pose, vehicle, to_pixels, color)
    return with_scale_bar(np.vstack([_title(result, image.shape[1]), image, _legend(result, image)]), pixels_per_m)


class _ToPixels:
    """Map-frame points (N, 2) to pixels with fractions, as OpenCV wants them."""

    def __init__(self, grid: OccupancyGrid, left_top: tuple[int, int], scale: float) -> None:
        self._grid, self._left_top, self._scale = grid, left_top, scale

    def __call__(self, points: FloatArray) -> NDArray[np.int32]:
        cells = self._grid.cell_coordinates(points)
        left, top = self._left_top
        pixels = np.column_stack([cells[:, 0] - left, top - cells[:, 1]]) * self._scale
        return np.asarray(np.clip(np.round(pixels * 2**_FRACTION), -_FAR, _FAR), dtype=np.int32)


def _canvas(grid: OccupancyGrid, poses: FloatArray, vehicle: Vehicle) -> tuple[Image, _ToPixels, float]:
    """Return the map around the poses (N, 3), how points get on it, and pixels a metre."""
    rows, cols = grid.log_odds.shape
    cell_m = grid.resolution_m
    cells = grid.cell_coordinates(poses[:, :2])
    off = np.maximum(-cells, cells - (cols, rows)).max(axis=1) * cell_m
    shown = cells[off < _FAR_OUTSIDE_M]
    if not len(shown):
        shown = np.array([[0.0, 0.0], [cols, rows]])
    low, high = shown.min(axis=0), shown.max(axis=0)
    room = max(_ROOM_M + vehicle.outer_radius_m, _ROOM_SHARE * float((high - low).max()) * cell_m) / cell_m
    left, bottom = np.floor(low - room).astype(int).tolist()
    right, top = np.ceil(high + room).astype(int).tolist()
    part = np.zeros((top - bottom, right - left), np.float32)  # unknown beyond the map
    inside = (max(bottom, 0), min(top, rows), max(left, 0), min(right, cols))
    part[inside[0] - bottom : inside[1] - bottom, inside[2] - left : inside[3] - left] = grid.log_odds[
        inside[0] : inside[1], inside[2] : inside[3]
    ]
    scale = max(_LONG_SIDE_PX / max(part.shape), _LEAST_WIDTH_PX / part.shape[1])
    size = (max(1, round(part.shape[1] * scale)), max(1, round(part.shape[0] * scale)))
    upright = np.ascontiguousarray(np.flipud(cell_shades(part, _PALE_WALL_GRAY)))
    fitting = cv2.resize(upright, size, interpolation=cv2.INTER_NEAREST if scale >= 1.0 else cv2.INTER_AREA)
    image = np.asarray(cv2.cvtColor(fitting, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return image, _ToPixels(grid, (left, top), scale), scale / cell_m


def _draw_path(image: Image, path: Path, vehicle: Vehicle, to_pixels: _ToPixels) -> None:
    """Draw outlines of the car on its way, the way in the colours of its gears, and a dot at each cusp."""
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.poses[:, :2], axis=0).T))])
    for pose in path.poses[np.searchsorted(along_m, np.arange(_OUTLINE_EVERY_M, along_m[-1], _OUTLINE_EVERY_M))]:
        outline = to_pixels(se2.transform_points(pose, vehicle.body))
        cv2.polylines(image, [outline], True, _SWEPT_BGR, 1, cv2.LINE_AA, _FRACTION)
    points = to_pixels(path.poses[:, :2])
    for first, last in pairwise([0, *path.cusps.tolist(), len(points) - 1]):
        color = _FORWARD_BGR if path.direction[first] > 0 else _BACKWARD_BGR
        cv2.polylines(image, [points[first : last + 1]], False, color, 2, cv2.LINE_AA, _FRACTION)
    for x, y in points[path.cusps].tolist():
        _draw_cusp(image, x, y)


def _draw_cusp(image: Image, x: int, y: int) -> None:
    radius = 5 << _FRACTION
    cv2.circle(image, (x, y), radius, _WHITE_BGR, cv2.FILLED, cv2.LINE_AA, _FRACTION)
    cv2.circle(image, (x, y), radius, _INK_BGR, 2, cv2.LINE_AA, _FRACTION)


def _draw_car(image: Image, pose: FloatArray, vehicle: Vehicle, to_pixels: _ToPixels, color: Color) -> None:
    """Draw the outline of the car's body, and a line from its rear axle to its front."""
    if np.abs(to_pixels(pose[np.newaxis, :2])).max() == _FAR:
        return
    nose = np.array([[0.0, 0.0], [vehicle.body[:, 0].max(), 0.0]])
    cv2.polylines(image, [to_pixels(se2.transform_points(pose, vehicle.body))], True, color, 2, cv2.LINE_AA, _FRACTION)
    cv2.polylines(image, [to_pixels(se2.transform_points(pose, nose))], False, color, 2, cv2.LINE_AA, _FRACTION)


def _title(result: PlanResult, width_px: int) -> Image:
    strip = np.full((34, width_px, 3), 255, np.uint8)
    write_text(strip, fitted(plan_summary(result), width_px - 24, 0.6), (12, 23), 0.6)
    return strip


def plan_summary(result: PlanResult) -> str:
    """Return the plan in one line: length, gear changes and clearance, or the error and its reason."""
    if result.path is None:
        return f"{result.error.nav2_name if result.error else 'no path'}: {result.reason}"
    cusps, clearance_m = len(result.path.cusps), result.min_clearance_m
    wall = "" if clearance_m is None or np.isinf(clearance_m) else f", nearest wall {clearance_m:.3f} m from the body"
    return f"{result.path.length_m:.2f} m, {cusps} gear change{'' if cusps == 1 else 's'}{wall}"


def _legend(result: PlanResult, image: Image) -> Image:
    """Return a strip that says what is what, of what there is."""
    entries = [("start", _START_BGR), ("goal", _GOAL_BGR)]
    if result.advice is not None:
        entries.append(("a pose that would do", _ADVICE_BGR))
    if result.path is not None:
        gears = set(result.path.direction.tolist())
        entries += [("forwards", _FORWARD_BGR)] * (1 in gears) + [("backwards", _BACKWARD_BGR)] * (-1 in gears)
    strip = np.full((34, image.shape[1], 3), 255, np.uint8)
    x = 12
    for text, color in entries:
        cv2.line(strip, (x, 17), (x + 26, 17), color, 3)
        write_text(strip, text, (x + 34, 22), 0.5)
        x += 34 + text_width_px(text, 0.5) + 24
    if result.path is not None and len(result.path.cusps):
        _draw_cusp(strip, (x + 6) << _FRACTION, 17 << _FRACTION)
        write_text(strip, "gear change", (x + 20, 22), 0.5)
    return strip
