"""Panels of a picture about maps: one map alone, two over each other, a surface of scores; each with its scale."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster
from mapping import se2
from mapping.grid import LogOdds, OccupancyGrid
from tools.lettering import INK_BGR, text_width_px, write_text
from tools.map_overlay import (
    COLORS_BGR,
    View,
    overlay_image,
    pixels_of,
    raster_for,
    seen_on,
    view_of,
    view_of_both,
)
from tools.pictures import Image, cell_shades

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]

MARK_BGR: Color = (150, 40, 120)  # purple: features and the slide
_MOST_FEATURES = 300
_SHORTEST_SLIDE_PX = 26.0
_ROUND_M = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_TINY_PX = 14  # a map smaller than that is ringed
_SHIFT_BITS = 4  # of fractions of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class OverlayMarks:
    """What is drawn on an overlay besides the maps: axes; matching points (N, 2), each in its map's frame; slide.

    slide: direction in rad in a's frame and metres either way in which the pose is loose.
    """

    axes: bool = True
    points_a: FloatArray | None = None
    points_b: FloatArray | None = None
    slide: tuple[float, float] | None = None


def overlay_panel(
    a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray, shape: tuple[int, int], marks: OverlayMarks | None = None
) -> Image:
    """Return both maps in a's frame in a picture of shape (rows, cols); with marks also walls two pixels wide."""
    raster = raster_for(view_of_both(a, b, T_a_b), shape)
    cells_a, cells_b = seen_on(a, se2.IDENTITY, raster), seen_on(b, T_a_b, raster)
    image = overlay_image(cells_a, cells_b, raster.resolution_m, stroke_px=2 if marks else 1)
    if marks:
        _draw_features(image, raster, T_a_b, marks)
        if marks.axes:
            _draw_axes(image, raster, se2.IDENTITY, "A", COLORS_BGR["wall a"])
            _draw_axes(image, raster, T_a_b, "B", COLORS_BGR["wall b"])
        if marks.slide is not None:
            common = np.argwhere((cells_a != 0.0) & (cells_b != 0.0))[:, ::-1] + 0.5
            middle = common.mean(axis=0) * raster.resolution_m + raster.origin[:2] if len(common) else T_a_b[:2]
            _draw_slide(image, raster, np.asarray(middle), marks.slide)
    draw_scale_bar(image, raster.resolution_m)
    return image


def single_panel(
    grid: OccupancyGrid,
    shape: tuple[int, int],
    color: Color,
    other: OccupancyGrid | None,
    T_map_other: FloatArray | None,
) -> Image:
    """Return a map in its own frame as a map_server shows it; what the other map has seen too is outlined."""
    raster = raster_for(view_of(grid), shape)
    cells = seen_on(grid, se2.IDENTITY, raster)
    image = np.asarray(cv2.cvtColor(np.ascontiguousarray(cell_shades(cells)[::-1]), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    if other is not None and T_map_other is not None:
        common = (cells != 0.0) & (seen_on(other, T_map_other, raster) != 0.0)
        solid = cv2.morphologyEx(common[::-1].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
        outlines = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        large = [outline for outline in outlines if len(outline) > 20] or list(outlines)
        cv2.drawContours(image, large, -1, color, 2, cv2.LINE_AA)
        _ring_if_tiny(image, raster, cells, se2.transform_points(T_map_other, view_of(other).corners), color)
    if not cells.any():
        text = "no known cell"
        write_text(image, text, ((shape[1] - text_width_px(text, 0.6)) / 2.0, shape[0] / 2.0), 0.6)
    draw_scale_bar(image, raster.resolution_m)
    return image


def score_panel(score: FloatArray, extent_m: tuple[float, float, float, float], shape: tuple[int, int]) -> Image:
    """Return a surface of scores (rows, cols), row 0 lowest, as a heat map with its best and second-best peak marked.

    extent_m: x_min, x_max, y_min, y_max of the array's edges. Dark is low; peaks closer than an eighth of the surface
    to the best are one with it.
    """
    x_min, x_max, y_min, y_max = extent_m
    raster = raster_for(View(np.array([x_min, y_min]), np.array([x_max, y_max])), shape, margin=0.0)
    image = np.full((*shape, 3), COLORS_BGR["unknown"], np.uint8)
    known = np.isfinite(score)
    finite = np.where(known, score, score[known].min() if known.any() else 0.0)
    low, high = np.percentile(finite, 50.0), finite.max()
    shades = np.clip((finite - low) / max(high - low, 1e-12), 0.0, 1.0) * 255.0
    (left, top), (right, bottom) = np.round(pixels_of(raster, np.array([(x_min, y_max), (x_max, y_min)]))).astype(int)
    size = (max(1, right - left), max(1, bottom - top))
    large = _largest_of_blocks(shades, (size[1], size[0]))
    heat = cv2.applyColorMap(
        cv2.resize(large[::-1].astype(np.uint8), size, interpolation=cv2.INTER_LINEAR), cv2.COLORMAP_VIRIDIS
    )
    image[top : top + size[1], left : left + size[0]] = heat[: shape[0] - top, : shape[1] - left]
    draw_scale_bar(image, raster.resolution_m)
    for number, (row, col) in enumerate(two_peaks(finite) if high > finite.min() else [], start=1):
        x = left + (col + 0.5) / score.shape[1] * size[0]
        y = top + size[1] - (row + 0.5) / score.shape[0] * size[1]
        cv2.circle(image, (round(x), round(y)), 9, (255, 255, 255), 4, cv2.LINE_AA)
        cv2.circle(image, (round(x), round(y)), 9, (0, 0, 0), 2, cv2.LINE_AA)
        write_text(image, str(number), (min(x + 12, shape[1] - 14), max(y - 6, 14)), 0.55, halo=True, bold=True)
    return image


def two_peaks(score: FloatArray) -> list[tuple[int, int]]:
    """Return (row, col) of the highest value and of the highest one outside its surroundings, unless that is flat."""
    row, col = (int(index) for index in np.unravel_index(np.argmax(score), score.shape))
    apart = max(2, max(score.shape) // 8)
    rest = np.array(score, dtype=np.float64)
    rest[max(0, row - apart) : row + apart + 1, max(0, col - apart) : col + apart + 1] = -np.inf
    if rest.max() <= score.min():
        return [(row, col)]
    second = np.unravel_index(np.argmax(rest), rest.shape)
    return [(row, col), (int(second[0]), int(second[1]))]


def draw_scale_bar(image: Image, pixel_m: float) -> None:
    """Draw a bar of a round length into the lower right corner."""
    rows, cols = image.shape[:2]
    length_m = max([m for m in _ROUND_M if m <= min(cols / 3.0, rows / 2.0) * pixel_m] or [_ROUND_M[0]])
    length = min(round(length_m / pixel_m), cols - 20)
    text, scale = f"{length_m:g} m", 0.5 if cols > 300 else 0.4
    left, y = cols - length - text_width_px(text, scale) - 18, rows - 16
    ends = [((left, y), (left + length, y))] + [((x, y - 5), (x, y + 5)) for x in (left, left + length)]
    for color, width in (((255, 255, 255), 6), (INK_BGR, 2)):
        for start, end in ends:
            cv2.line(image, start, end, color, width)
    write_text(image, text, (left + length + 6, y + 5), scale, halo=True)


def _largest_of_blocks(values: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Return the array with no more rows and cols than the shape, each value the largest that fell on it."""
    for axis in (0, 1):
        factor = math.ceil(values.shape[axis] / shape[axis])
        values = np.maximum.reduceat(values, np.arange(0, values.shape[axis], factor), axis=axis)
    return values


def _ring_if_tiny(image: Image, raster: Raster, cells: LogOdds, corners: FloatArray, color: Color) -> None:
    """Draw a ring around a box of corners (4, 2) that is hardly more than a dot, if it lies on known cells."""
    pixels = pixels_of(raster, corners)
    x, y = np.floor(pixels.mean(axis=0)).astype(int).tolist()
    rows, cols = cells.shape
    if np.ptp(pixels, axis=0).max() < _TINY_PX and 0 <= x < cols and 0 < y <= rows and cells[rows - y, x] != 0.0:
        cv2.circle(image, (x, y), _TINY_PX, color, 2, cv2.LINE_AA)


def _fixed(points: FloatArray) -> list[tuple[int, int]]:
    """Return pixels (N, 2) as the integers that OpenCV takes with fractional bits, kept near the picture."""
    limited = np.clip(points, -20000.0, 20000.0) * 2**_SHIFT_BITS
    return [(int(x), int(y)) for x, y in np.round(limited)]


def _draw_features(image: Image, raster: Raster, T_a_b: FloatArray, marks: OverlayMarks) -> None:
    """Draw a cross at each point of a and a line to its match of b."""
    if marks.points_a is None or marks.points_b is None or len(marks.points_a) == 0:
        return
    chosen = slice(None, None, max(1, math.ceil(len(marks.points_a) / _MOST_FEATURES)))
    ends_a = pixels_of(raster, marks.points_a[chosen])
    ends_b = pixels_of(raster, se2.transform_points(T_a_b, marks.points_b[chosen]))
    for (ax, ay), start, end in zip(ends_a.tolist(), _fixed(ends_a), _fixed(ends_b), strict=True):
        cv2.line(image, start, end, MARK_BGR, 1, cv2.LINE_AA, _SHIFT_BITS)
        if 0 <= ax < image.shape[1] and 0 <= ay < image.shape[0]:
            cv2.drawMarker(image, (round(ax), round(ay)), MARK_BGR, cv2.MARKER_TILTED_CROSS, 11, 2, cv2.LINE_AA)


def _draw_axes(image: Image, raster: Raster, pose: FloatArray, name: str, color: Color) -> None:
    """Draw a frame's axes; in an upper corner, marked so, if its origin lies outside."""
    rows, cols = image.shape[:2]
    length_px = 46.0 if name == "A" else 32.0  # both are seen where the frames coincide
    label, at = name, pixels_of(raster, pose[np.newaxis, :2])[0]
    if ((at >= 0.0) & (at <= (cols, rows))).all():
        left = float(np.clip(at[0] + (-22 if name == "A" else 8), 6, cols - 20))
        base = float(np.clip(at[1] + 20, 20, rows - 8))
    else:
        label = f"{name} (origin outside)"
        width_px = text_width_px(label, 0.5, bold=True)
        left, base = (12 if name == "A" else cols - width_px - 12), 24
        at = np.array([left + width_px / 2.0, base + length_px + 10.0])
    for turn, width in ((0.0, 3), (math.pi / 2.0, 1)):
        angle = pose[2] + turn
        tip = at + length_px * np.array([math.cos(angle), -math.sin(angle)])
        start, end = _fixed(np.vstack([at, tip]))
        cv2.line(image, start, end, (255, 255, 255), width + 3, cv2.LINE_AA, _SHIFT_BITS)
        cv2.arrowedLine(image, start, end, color, width, cv2.LINE_AA, _SHIFT_BITS, 0.25)
        if turn == 0.0:
            write_text(image, "x", (float(tip[0]) + 4.0, float(tip[1]) + 4.0), 0.45, color, halo=True)
    write_text(image, label, (left, base), 0.5, color, bold=True, halo=True)


def _draw_slide(image: Image, raster: Raster, middle: FloatArray, slide: tuple[float, float]) -> None:
    """Draw a double arrow along which the pose is loose, and how far."""
    direction_rad, metres = slide
    rows, cols = image.shape[:2]
    length = float(np.clip(metres / raster.resolution_m, _SHORTEST_SLIDE_PX, 0.4 * min(rows, cols)))
    centre = np.clip(pixels_of(raster, middle[np.newaxis])[0], 40, (cols - 40, rows - 40))
    along = np.array([math.cos(direction_rad), -math.sin(direction_rad)])
    tips = _fixed(np.vstack([centre, centre + along * length, centre - along * length]))
    for color, width in (((255, 255, 255), 9), (MARK_BGR, 4)):
        for tip in tips[1:]:
            cv2.arrowedLine(image, tips[0], tip, color, width, cv2.LINE_AA, _SHIFT_BITS, 14.0 / length)
    text = f"may slide {metres:.{0 if metres >= 10.0 else 1}f} m either way"
    left = float(np.clip(centre[0] - text_width_px(text, 0.6, bold=True) / 2.0, 6, cols))
    base = float(np.clip(centre[1] + abs(along[1]) * length + 30.0, 20, rows - 40))
    write_text(image, text, (left, base), 0.6, MARK_BGR, bold=True, halo=True)
