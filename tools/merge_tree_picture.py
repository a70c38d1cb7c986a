"""Merging in levels as a picture (thesis figure 5.6): the local maps above, below them what they became; by OpenCV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.hierarchy import LevelMap
from tools.lettering import INK_BGR, fitted, text_width_px, write_text
from tools.map_overlay import View, raster_for
from tools.pictures import Image
from tools.placed_maps_picture import PlacedMap, corners_of, paint_maps
from tools.robot_picture import robot_color

FloatArray = NDArray[np.float64]
_LINE_BGR = (150, 150, 150)
_PAGE_PX, _SIDE_PX, _GAP_PX, _HEAD_PX, _FOOT_PX = 1500, 96, 18, 20, 40
_LEAF_PX, _MERGED_PX = (70, 240), (640, 420)  # width of a local map from, to; a merged one's width and height at most
_TEXT_PX, _BETWEEN_PX = 44, 40
_ASPECT = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class _Tile:
    """A map at its place in the picture: pixels of the upper left corner, and the size."""

    of: LevelMap
    left: int
    width: int
    height: int

    @property
    def middle(self) -> int:
        return self.left + self.width // 2


def draw_tree(tops: Sequence[LevelMap], titles: Mapping[str, str]) -> Image:
    """Return a picture of how maps were merged: tops as the last level left them, titles of the original maps.

    Each original map has a colour, in which its walls are drawn in all that it became part of.
    """
    order = {name: number for number, name in enumerate(_leaves(tops))}
    leaf = int(np.clip(_PAGE_PX // max(len(order), 1) - _GAP_PX, *_LEAF_PX))
    tiles = [tile for top in tops for tile in _tiles(top, order, leaf)]
    heights = [
        max((tile.height for tile in tiles if tile.of.level == level), default=0)
        for level in range(1 + max(tile.of.level for tile in tiles))
    ]
    starts = np.cumsum([_HEAD_PX, *(height + _TEXT_PX + _BETWEEN_PX for height in heights)]).tolist()
    width = _SIDE_PX + len(order) * (leaf + _GAP_PX)
    image = np.full((starts[-1] - _BETWEEN_PX + _FOOT_PX, max(width, 420), 3), 255, np.uint8)
    by_map = {id(tile.of): tile for tile in tiles}
    for tile in tiles:
        for part in tile.of.parts or ():
            _draw_edge(image, by_map[id(part)], tile, starts)
    for tile in tiles:
        _draw_tile(image, tile, starts[tile.of.level], order, titles)
    for level, top in enumerate(starts[:-1]):
        text = f"level {level}" if level else "local"
        write_text(image, text, (14, top + heights[level] / 2), 0.55, bold=True)
    note = "walls in the colour of the map that saw them, dark where several did"
    write_text(image, fitted(note, image.shape[1] - 28, 0.45), (14, image.shape[0] - 14), 0.45)
    return image


def _leaves(tops: Sequence[LevelMap]) -> list[str]:
    """Return the names of the original maps as they stand side by side."""
    names: list[str] = []
    for top in tops:
        names += _leaves(top.parts) if top.parts else [top.name]
    return names


def _tiles(top: LevelMap, order: Mapping[str, int], leaf: int) -> list[_Tile]:
    """Return the tiles of a map and of all that it was made of, each in the middle above or below the others."""
    if not top.parts:
        return [_Tile(top, _SIDE_PX + order[top.name] * (leaf + _GAP_PX), leaf, round(leaf * _ASPECT))]
    parts = [_tiles(part, order, leaf) for part in top.parts]
    middle = sum(tiles[0].middle for tiles in parts) // 2
    room = len(top.contributions) * (leaf + _GAP_PX) - _GAP_PX
    width = min(room, _MERGED_PX[0])
    low = _SIDE_PX + min(order[name] for name in top.contributions) * (leaf + _GAP_PX)
    left = int(np.clip(middle - width // 2, low, low + room - width))
    return [_Tile(top, left, width, min(round(width * _ASPECT), _MERGED_PX[1])), *parts[0], *parts[1]]


def _draw_edge(image: Image, part: _Tile, whole: _Tile, starts: Sequence[int]) -> None:
    """Draw a line from below a map to the top of what it became part of."""
    start = starts[part.of.level] + part.height + _TEXT_PX
    end = starts[whole.of.level]
    bend = end - _BETWEEN_PX // 2
    corners = [(part.middle, start), (part.middle, bend), (whole.middle, bend), (whole.middle, end - 3)]
    cv2.polylines(image, [np.array(corners, np.int32)], False, _LINE_BGR, 2, cv2.LINE_AA)
    tip = np.array([(-6, -10), (6, -10), (0, -1)]) + np.array([whole.middle, end])
    cv2.fillPoly(image, [tip.astype(np.int32)], _LINE_BGR, cv2.LINE_AA)


def _draw_tile(image: Image, tile: _Tile, top: int, order: Mapping[str, int], titles: Mapping[str, str]) -> None:
    """Draw a map in its frame with what it is called."""
    box = image[top : top + tile.height, tile.left : tile.left + tile.width]
    box[:] = _picture(tile, order)
    leaf = tile.of.parts is None
    color = robot_color(order[tile.of.name]) if leaf else INK_BGR
    cv2.rectangle(image, (tile.left, top), (tile.left + tile.width - 1, top + tile.height - 1), color, 2)
    lines = [titles[tile.of.name], f"{tile.of.grid.resolution_m:g} m a cell"] if leaf else _merged_lines(tile.of)
    scale = 0.45 if tile.width >= 120 else 0.38
    for number, line in enumerate(lines):
        text = fitted(line, tile.width + _GAP_PX - 6, scale)
        left = tile.middle - text_width_px(text, scale) / 2.0
        write_text(image, text, (left, top + tile.height + 17 + 19 * number), scale, color if number == 0 else INK_BGR)


def _merged_lines(merged: LevelMap) -> list[str]:
    found = merged.merged_by
    inliers = f", {found.inliers} inliers" if found is not None and found.inliers is not None else ""
    index = f"acceptance index {found.acceptance:.3f}" if found is not None else ""
    return [f"{len(merged.contributions)} maps{inliers}", index]


def _picture(tile: _Tile, order: Mapping[str, int]) -> Image:
    """Return the map as a picture of the tile's size."""
    parts = tile.of.contributions
    maps = [PlacedMap(each.grid, each.T_global_map, robot_color(order[name])) for name, each in parts.items()]
    corners = corners_of(maps)
    raster = raster_for(View(corners.min(axis=0), corners.max(axis=0)), (tile.height, tile.width), margin=0.05)
    picture = np.full((tile.height, tile.width, 3), 255, np.uint8)
    paint_maps(picture, raster, maps)
    return picture
