"""The picture of a registration's verdict: what was decided, how sure that is, and why, for a person's one glance."""

from __future__ import annotations

from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from tools.alignment_view import AlignmentView, chance_text, figures, headline, percent, pose_text
from tools.lettering import fitted, text_width_px, wrapped, write_text
from tools.map_overlay import COLORS_BGR, View, raster_for, reduced, reduction, view_of, view_of_both
from tools.map_panels import MARK_BGR, Color, OverlayMarks, overlay_panel, score_panel, single_panel
from tools.pictures import Image

FloatArray = NDArray[np.float64]
__all__ = ["AlignmentView", "draw_alignment"]

WIDTH_PX, HEIGHT_PX = 1600, 1000
VERDICT_COLORS_BGR = MappingProxyType({"accepted": (94, 120, 0), "refused": (50, 20, 175), "ambiguous": (0, 105, 185)})
_PAPER_BGR, _PALE_INK_BGR, _RULE_BGR = (255, 255, 255), (110, 110, 110), (205, 205, 205)
_EDGE_PX, _GAP_PX = 16, 12
_REASON_SIZES = ((0.7, 25, 3), (0.55, 17, 4), (0.45, 14, 5))  # of letters, px a line, lines
_TOP_PX, _BOTTOM_PX = 142, 940  # of the main panel
_MAIN_PX, _SIDE_PX = 1040, 512  # widths
_BADGE_PX = 384
_TITLE_PX = 30  # between panels, for the title of the lower one
_ROW_PX = 28  # of the figures
_MOST_TILES, _LARGEST_TILE_PX, _HIGHEST_PX = 3, 250, 300
_CAPTION_PX = 22


def draw_alignment(a: OccupancyGrid, b: OccupancyGrid, view: AlignmentView) -> Image:
    """Return the verdict on two maps as a BGR picture of 1000 x 1600 pixels."""
    page = np.full((HEIGHT_PX, WIDTH_PX, 3), _PAPER_BGR, np.uint8)
    a, b = _reduced_to_page(a, b, view.T_a_b)
    _draw_header(page, view)
    tiles = _tiles(a, b, view)
    if view.T_a_b is None:
        _draw_unplaced(page, a, b, view, _MAIN_PX if tiles else WIDTH_PX - 2 * _EDGE_PX)
        _draw_tiles(page, tiles, _TOP_PX)
        return page
    _draw_places(page, a, b, view, view.T_a_b)
    _draw_legend(page, view)
    numbers = figures(view, view.T_a_b)
    numbers_top = HEIGHT_PX - _EDGE_PX - _ROW_PX * len(numbers)
    tiles_px = tiles[0][1].shape[0] + _TITLE_PX if tiles else 0
    y = _draw_maps_alone(page, a, b, view, numbers_top - tiles_px - _TOP_PX)
    _draw_tiles(page, tiles, y)
    _draw_numbers(page, numbers, numbers_top)
    return page


def _reduced_to_page(
    a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray | None
) -> tuple[OccupancyGrid, OccupancyGrid]:
    """Return the maps no finer than any panel can show, so that each panel costs little."""
    pixels_m = [raster_for(view_of(grid), (_MAIN_PX, _MAIN_PX)).resolution_m for grid in (a, b)]
    if T_a_b is not None:
        together_m = raster_for(view_of_both(a, b, T_a_b), (_BOTTOM_PX - _TOP_PX, _MAIN_PX)).resolution_m
        pixels_m = [min(2.0 * pixel_m, together_m) for pixel_m in pixels_m]
    finest_a, finest_b = pixels_m
    return reduced(a, reduction(a, finest_a)), reduced(b, reduction(b, finest_b))


def _draw_header(page: Image, view: AlignmentView) -> None:
    """Draw the verdict, what it means and its reason."""
    color = VERDICT_COLORS_BGR[view.verdict.lower()]
    cv2.rectangle(page, (_EDGE_PX, 12), (_EDGE_PX + _BADGE_PX, 112), color, cv2.FILLED)
    chance = chance_text(view)
    for text, scale, base in ((view.verdict.upper(), 1.75, 66 if chance else 80), (chance, 0.8, 98)):
        x = _EDGE_PX + (_BADGE_PX - text_width_px(text, scale, bold=True)) / 2.0
        write_text(page, text, (x, base), scale, _PAPER_BGR, bold=True)
    x, width = _EDGE_PX + _BADGE_PX + 24, WIDTH_PX - 2 * _EDGE_PX - _BADGE_PX - 24
    write_text(page, fitted(headline(view), width, 0.85, bold=True), (x, 36), 0.85, bold=True)
    scale, step_px, lines = next(
        (scale, step_px, lines)
        for scale, step_px, most in _REASON_SIZES
        if not (lines := wrapped(f"Why: {view.reason}", width, scale, most))[-1].endswith("...")
        or most == _REASON_SIZES[-1][2]
    )
    for number, line in enumerate(lines):
        write_text(page, line, (x, 62 + step_px * number), scale)


def _draw_unplaced(page: Image, a: OccupancyGrid, b: OccupancyGrid, view: AlignmentView, width_px: int) -> None:
    """Draw the maps side by side, each in its own frame."""
    shape = (HEIGHT_PX - _EDGE_PX - _TOP_PX, (width_px - _GAP_PX) // 2)
    for number, grid in enumerate((a, b)):
        corner = (_EDGE_PX + number * (shape[1] + _GAP_PX), _TOP_PX)
        color = COLORS_BGR[f"wall {'ab'[number]}"]
        _place(page, single_panel(grid, shape, color, None, None), corner, _map_title(view, number, grid), color, 4)


def _draw_places(page: Image, a: OccupancyGrid, b: OccupancyGrid, view: AlignmentView, T_a_b: FloatArray) -> None:
    """Draw the maps over each other; at two places if that is the question."""
    color = VERDICT_COLORS_BGR[view.verdict.lower()]
    marks = OverlayMarks(True, view.points_a, view.points_b, view.slide)
    if view.verdict.lower() == "ambiguous" and view.alternatives:
        second, probability = view.alternatives[0]
        shape = _half_shape([view_of_both(a, b, pose) for pose in (T_a_b, second)], (_BOTTOM_PX - _TOP_PX, _MAIN_PX))
        corner = (_EDGE_PX, _TOP_PX)
        places = (("best", T_a_b, view.probability, marks), ("2nd best", second, probability, OverlayMarks()))
        for name, pose, chance, drawn in places:
            title = name + ("" if chance is None else f" ({percent(chance)})") + f": {pose_text(pose)}"
            _place(page, overlay_panel(a, b, pose, shape, drawn), corner, title, color, 4)
            right, below = corner[0] + shape[1] + _GAP_PX, corner[1] + shape[0] + _TITLE_PX
            corner = (right, corner[1]) if shape[1] < _MAIN_PX else (corner[0], below)
        return
    title = "both maps, in the frame of A, with B at the " + (
        "place found" if view.verdict.lower() == "accepted" else "best guess, which was NOT believed"
    )
    if view_of_both(a, b, T_a_b).zoomed:
        title += "; zoomed in on the smaller map"
    image = overlay_panel(a, b, T_a_b, (_BOTTOM_PX - _TOP_PX, _MAIN_PX), marks)
    _place(page, image, (_EDGE_PX, _TOP_PX), title, color, 4)


def _half_shape(views: list[View], shape: tuple[int, int]) -> tuple[int, int]:
    """Return the shape of two panels, side by side or one above the other, that shows the views largest."""
    rows, cols = shape
    halves = ((rows, (cols - _GAP_PX) // 2), ((rows - _TITLE_PX) // 2, cols))
    return min(halves, key=lambda half: max(raster_for(view, half).resolution_m for view in views))


def _draw_maps_alone(page: Image, a: OccupancyGrid, b: OccupancyGrid, view: AlignmentView, room_px: int) -> int:
    """Draw each map as it is, with the area outlined that the other one saw too; return the y below them."""
    T_a_b = se2.IDENTITY if view.T_a_b is None else view.T_a_b
    x, y = WIDTH_PX - _EDGE_PX - _SIDE_PX, _TOP_PX
    rows = room_px - _TITLE_PX - _CAPTION_PX
    shape = _half_shape([view_of(a), view_of(b)], (rows, _SIDE_PX))
    below = shape[1] == _SIDE_PX
    if not below:
        shape = (min(rows, _HIGHEST_PX), shape[1])
    for number, (grid, other, pose) in enumerate(((a, b, T_a_b), (b, a, se2.inverse(T_a_b)))):
        color = COLORS_BGR[f"wall {'ab'[number]}"]
        image = single_panel(grid, shape, COLORS_BGR[f"wall {'ba'[number]}"], other, pose)
        _place(page, image, (x, y), _map_title(view, number, grid), color, 2)
        x, y = (x, y + shape[0] + _TITLE_PX) if below else (x + shape[1] + _GAP_PX, y)
    y += (0 if below else shape[0] + _TITLE_PX) - _TITLE_PX
    text = "outlined: what the other map has seen too"
    write_text(page, text, (WIDTH_PX - _EDGE_PX - _SIDE_PX, y + 17), 0.45, _PALE_INK_BGR)
    return y + _CAPTION_PX + _TITLE_PX


def _tiles(a: OccupancyGrid, b: OccupancyGrid, view: AlignmentView) -> list[tuple[str, Image]]:
    """Return the next best places and the surface of scores, each with its title."""
    first = 1 if view.verdict.lower() == "ambiguous" and view.T_a_b is not None else 0
    poses = view.alternatives[first : first + _MOST_TILES - (view.score is not None)]
    count = len(poses) + (view.score is not None)
    if count == 0:
        return []
    side_px = min(_LARGEST_TILE_PX, (_SIDE_PX - _GAP_PX * (count - 1)) // count)
    tiles = []
    ranks = ("2nd", "3rd", "4th", "5th")[first if view.T_a_b is not None else 0 :]
    for rank, (pose, probability) in zip(ranks, poses, strict=False):
        title = f"{rank} best: {percent(probability)}"
        tiles.append((title, overlay_panel(a, b, pose, (side_px, side_px))))
    if view.score is not None and view.score_extent_m is not None:
        tiles.append(("score of each shift", score_panel(view.score, view.score_extent_m, (side_px, side_px))))
    return tiles


def _draw_tiles(page: Image, tiles: list[tuple[str, Image]], top: int) -> None:
    """Draw the tiles in a row."""
    x = WIDTH_PX - _EDGE_PX - _SIDE_PX
    for title, image in tiles:
        _place(page, image, (x, top), title, _PALE_INK_BGR, 1)
        x += image.shape[1] + _GAP_PX


def _draw_numbers(page: Image, rows: list[tuple[str, str]], top: int) -> None:
    left, right = WIDTH_PX - _EDGE_PX - _SIDE_PX, WIDTH_PX - _EDGE_PX
    for number, (name, value) in enumerate(rows):
        y = top + _ROW_PX * number
        cv2.line(page, (left, y), (right, y), _RULE_BGR, 1)
        write_text(page, name, (left, y + 20), 0.55)
        write_text(page, value, (right - text_width_px(value, 0.6, bold=True), y + 20), 0.6, bold=True)


def _draw_legend(page: Image, view: AlignmentView) -> None:
    """Draw what the colours of the overlays mean."""
    lines = [
        [("wall a", "wall of A only"), ("wall b", "wall of B only"), ("wall both", "wall seen by both"),
         ("conflict", "contradiction: wall of one, free in the other")],
        [("free a", "free in A only"), ("free b", "free in B only"), ("free both", "free in both"),
         ("unknown", "not seen")],
    ]  # fmt: skip
    for number, line in enumerate(lines):
        x, y = _EDGE_PX, _BOTTOM_PX + 9 + 23 * number
        for name, text in line:
            cv2.rectangle(page, (x, y), (x + 22, y + 14), COLORS_BGR[name], cv2.FILLED)
            cv2.rectangle(page, (x, y), (x + 22, y + 14), _PALE_INK_BGR, 1)
            write_text(page, text, (x + 30, y + 13), 0.5)
            x += 200
        if number == 1 and view.points_a is not None:
            cv2.drawMarker(page, (x + 11, y + 7), MARK_BGR, cv2.MARKER_TILTED_CROSS, 9, 1, cv2.LINE_AA)
            write_text(page, "matching feature", (x + 30, y + 13), 0.5)


def _place(page: Image, image: Image, corner: tuple[int, int], title: str, color: Color, frame_px: int) -> None:
    """Put a panel into the page, its upper left corner at (x, y), in a frame, with its title above."""
    x, y = corner
    rows, cols = image.shape[:2]
    page[y : y + rows, x : x + cols] = image
    cv2.rectangle(page, (x, y), (x + cols - 1, y + rows - 1), color, frame_px)
    write_text(page, fitted(title, cols, 0.5), (x, y - 7), 0.5)


def _map_title(view: AlignmentView, number: int, grid: OccupancyGrid) -> str:
    """Return the map's name and size."""
    box = view_of(grid)
    width_m, height_m = (box.high - box.low).tolist()
    size = f"{'AB'[number]}, {width_m:.3g} x {height_m:.3g} m"
    return f"{size}: {view.names[number]}" if view.names else f"map {size}"
