"""Local maps where they truly are (figure 5.5), and a global map on the floor plan (figure 5.7); drawn with OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from mapping.map_io import read_map
from tools.floor_plan import PLAN_BGR, draw_plan, plan_lines
from tools.lettering import INK_BGR, fitted, text_width_px, write_text
from tools.map_data_set import FloorPlan, MapDataSet
from tools.map_overlay import View, raster_for
from tools.pictures import Image, with_scale_bar, write_picture
from tools.placed_maps_picture import Color, PlacedMap, corners_of, paint_maps
from tools.robot_picture import robot_color

_LONG_SIDE_PX, _ROW_PX, _TINT = 1200, 26, 0.22


def draw_local_maps(file: Path, data: MapDataSet) -> None:
    """Write a PNG of a set's maps at their true poses, each in its colour, on the floor plan where there is one.

    Raises MapFileError and ToolError.
    """
    maps, labels = [], []
    for number, each in enumerate(data.maps):
        assert each.pose is not None, "asked for only where all poses are known"
        maps.append(PlacedMap(read_map(each.path), each.pose, robot_color(number)))
        rate = "" if each.rate_hz is None else f", {each.rate_hz:.2g} Hz"
        labels.append((f"{each.robot or each.name}: {each.cells_per_meter:g} cells/m{rate}", robot_color(number)))
    write_picture(file, placed_on_plan(maps, labels, data.floor_plan))


def placed_on_plan(maps: Sequence[PlacedMap], labels: Sequence[tuple[str, Color]], plan: FloorPlan | None) -> Image:
    """Return maps placed in the set's frame on its floor plan, if its scale and pose are known, with a legend."""
    corners = corners_of(maps)
    drawn = plan is not None and plan.resolution_m is not None and plan.pose is not None
    lines = plan_lines(plan) if drawn and plan is not None else np.empty((0, 2))
    corners = np.vstack([corners, lines])
    low, high = corners.min(axis=0), corners.max(axis=0)
    size = _LONG_SIDE_PX * (high - low) / (high - low).max()
    shape = max(round(size[1]), 200), max(round(size[0]), 400)
    raster = raster_for(View(low, high), shape, margin=0.02)
    picture = np.full((*raster.shape, 3), 255, np.uint8)
    paint_maps(picture, raster, maps, stroke_px=2, tint=_TINT)
    if plan is not None and plan.resolution_m is not None and len(lines):
        draw_plan(picture, raster, lines, plan.resolution_m)
    picture = with_scale_bar(picture, 1.0 / raster.resolution_m)
    return np.vstack([picture, _legend([*labels, *([("floor plan", PLAN_BGR)] if drawn else [])], shape[1])])


def _legend(labels: Sequence[tuple[str, Color]], width_px: int) -> Image:
    """Return a strip that says what the colours are."""
    texts = [fitted(text, width_px - 60, 0.5) for text, _ in labels]
    step = min(width_px, max(text_width_px(text, 0.5) for text in texts) + 60)
    columns = max(1, (width_px - 8) // step)
    strip = np.full((-(-len(texts) // columns) * _ROW_PX + 10, width_px, 3), 255, np.uint8)
    for number, (text, (_, color)) in enumerate(zip(texts, labels, strict=True)):
        left, base = 12 + number % columns * step, _ROW_PX * (number // columns) + 22
        cv2.line(strip, (left, base - 5), (left + 24, base - 5), color, 5)
        write_text(strip, text, (left + 32, base), 0.5, INK_BGR)
    return strip
