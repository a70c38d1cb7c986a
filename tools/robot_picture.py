"""A fused map with its robots: where each drove, in a colour of its own, and where it is now; drawn with OpenCV."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid
from tools.lettering import fitted, text_width_px, write_text
from tools.pictures import Image, drawn_cells, with_scale_bar

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]

# Of Okabe and Ito, darkened where they were pale on white: told apart by the colour-blind too.
_COLORS_BGR: tuple[Color, ...] = (
    (178, 104, 0),
    (0, 94, 213),
    (105, 150, 0),
    (160, 90, 190),
    (0, 160, 235),
    (215, 165, 60),
    (40, 60, 120),
)
_WHITE_BGR = (255, 255, 255)
_SHIFT_BITS = 4  # of fractions of a pixel
_PX_A_WIDTH = 500  # the picture's longer side for each pixel of a line's width
_ROW_PX, _MOST_ROWS = 30, 8
_FARTHEST_PX, _PLAIN_WIDTH_PX = 50_000, 1300


def robot_color(number: int) -> Color:
    """Return the BGR colour of the robot of a number; more than seven get hues that are spread by the golden ratio."""
    if number < len(_COLORS_BGR):
        return _COLORS_BGR[number]
    red, green, blue = colorsys.hsv_to_rgb((0.1 + 0.618034 * number) % 1.0, 0.8, 0.7)
    return round(blue * 255), round(green * 255), round(red * 255)


def draw_robots(grid: OccupancyGrid, robots: Sequence[tuple[str, FloatArray]]) -> Image:
    """Return the map with robots (name, poses (N, 3) in the map frame): a ring where each began, an arrow where it is.

    The strip below says which is which.
    """
    paths = [poses[:, :2] for _, poses in robots]
    image, pixels, scale = drawn_cells(grid, np.vstack([np.zeros((0, 2)), *paths]), darkest=0)
    width = max(2, round(max(image.shape[:2]) / _PX_A_WIDTH))
    pixels = np.clip(pixels, -_FARTHEST_PX, _FARTHEST_PX)  # what is off the picture must fit OpenCV's numbers
    tracks = np.split(pixels, np.cumsum([len(path) for path in paths])[:-1]) if robots else []
    for number, track in enumerate(tracks):
        line = [np.round(track * 2**_SHIFT_BITS).astype(np.int32)]
        cv2.polylines(image, line, False, _WHITE_BGR, width + 2, cv2.LINE_AA, _SHIFT_BITS)
        cv2.polylines(image, line, False, robot_color(number), width, cv2.LINE_AA, _SHIFT_BITS)
    for number, track in enumerate(tracks):  # above all lines
        x, y = np.round(track[0]).astype(int).tolist()
        for radius, color in ((4 * width, _WHITE_BGR), (3 * width, robot_color(number)), (2 * width, _WHITE_BGR)):
            cv2.circle(image, (x, y), radius, color, cv2.FILLED, cv2.LINE_AA)
        _draw_arrow(
            image, track[-1], float(robots[number][1][-1, 2] - grid.origin[2]), 8.0 * width, robot_color(number)
        )
    image = with_scale_bar(image, scale / grid.resolution_m)
    return _with_legend(image, [name for name, _ in robots]) if robots else image


def _draw_arrow(image: Image, at: FloatArray, yaw_rad: float, length_px: float, color: Color) -> None:
    """Draw a dart on a white rim whose middle is at a pixel (2,)."""
    shape = np.array([(0.6, 0.0), (-0.5, 0.38), (-0.28, 0.0), (-0.5, -0.38)])
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turned = shape @ np.array([[cos, -sin], [sin, cos]])
    for size, shade in ((1.5, _WHITE_BGR), (1.0, color)):
        corners = np.round((at + turned * length_px * size) * 2**_SHIFT_BITS).astype(np.int32)
        cv2.fillPoly(image, [corners], shade, cv2.LINE_AA, _SHIFT_BITS)


def _with_legend(image: Image, names: Sequence[str]) -> Image:
    """Return the picture with the robots' names and colours below it; of very many only the first.

    The letters grow with the picture, since large ones are looked at reduced.
    """
    width_px = image.shape[1]
    size = max(1.0, width_px / _PLAIN_WIDTH_PX)
    scale, row_px, key_px = 0.55 * size, round(_ROW_PX * size), round(26 * size)
    labels = [fitted(name, max(width_px - 2 * key_px, 40), scale) for name in names]
    step = min(width_px, max(text_width_px(label, scale) for label in labels) + round(2.4 * key_px))
    columns = max(1, (width_px - 8) // step)
    rows = -(-len(labels) // columns)
    shown = labels[: columns * _MOST_ROWS]
    if rows > _MOST_ROWS:
        shown = [*shown[:-1], f"and {len(labels) - len(shown) + 1} more"]
    strip = np.full(((min(rows, _MOST_ROWS) + 1) * row_px + 8, width_px, 3), 255, np.uint8)
    for number, label in enumerate(shown):
        left, base = 12 + number % columns * step, row_px * (number // columns) + round(0.7 * row_px)
        if number < len(shown) - 1 or rows <= _MOST_ROWS:
            middle = base - round(5 * size)
            cv2.line(strip, (left, middle), (left + key_px, middle), robot_color(number), round(5 * size))
        write_text(strip, label, (left + round(1.3 * key_px), base), scale)
    marks = fitted("ring: where it began; arrow: where it is", width_px - 24, scale)
    write_text(strip, marks, (12, len(strip) - round(0.4 * row_px)), scale)
    return np.vstack([image, strip])
