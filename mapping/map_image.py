"""The image half of a map_server map: pixels to log-odds and back.

Values, thresholds and orientation are those of nav2 (nav2_map_server/src/map_io.cpp, as of 2025): image row 0 is the
highest y; at and beyond a threshold counts; transparent pixels are unknown; colours count by their luma; negate has no
say in mode raw. This is the only file of mapping that encodes or decodes images.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.errors import MapFileError
from mapping.grid import FREE_THRESHOLD, OccupancyGrid
from mapping.map_yaml import MapMode, MapYaml

ByteImage = NDArray[np.uint8]
Mask = NDArray[np.bool_]
LogOdds = NDArray[np.float32]
ImageFormat = Literal["pgm", "png"]

FREE_GRAY, OCCUPIED_GRAY, UNKNOWN_GRAY = 254, 0, 205
FREE_PROBABILITY, OCCUPIED_PROBABILITY = 0.004, 0.996  # what "free" and "occupied" of an image are worth
RAW_UNKNOWN = 255
_WHITE = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}
_UNDECIDED_LOG_ODDS = 1e-3  # a known cell at 50 %: exactly 0 would mean unknown


def encode_image(grid: OccupancyGrid, mode: MapMode, image_format: ImageFormat) -> bytes:
    """Return the grid as an image file; raises MapFileError for a grid too large for one."""
    try:
        encoded, data = cv2.imencode(f".{image_format}", _to_pixels(grid, mode))
    except cv2.error:
        encoded = False
    if not encoded:
        raise MapFileError(f"a map of {grid.log_odds.shape} cells does not fit a {image_format} image: use the .npz")
    return data.tobytes()


def decode_image(data: bytes, path: Path) -> tuple[ByteImage, Mask]:
    """Return brightness 0..255 (rows, cols), top row first, and where it is opaque; raises MapFileError.

    16-bit images, and PGM whose maximum is not 255, are scaled to 0..255 as nav2's image library does.
    """
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)  # OpenCV would print what is raised below
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        pixels = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if pixels is None or pixels.dtype not in _WHITE:
        raise MapFileError(
            f"{path}: {len(data)} bytes that are no 8- or 16-bit image, or not all of one: save it again"
        )
    white = _WHITE[pixels.dtype]
    opaque: Mask = np.ones(pixels.shape[:2], dtype=np.bool_)
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        opaque = np.asarray(pixels[:, :, 3] == white)
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGRA2GRAY)
    elif pixels.ndim == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    white = _stated_white(data, white)
    gray = pixels if white == 255 else np.clip(np.rint(pixels * (255.0 / white)), 0, 255)
    return np.asarray(gray, dtype=np.uint8), opaque


def to_log_odds(gray: ByteImage, opaque: Mask, settings: MapYaml) -> tuple[LogOdds, tuple[str, ...]]:
    """Return log-odds (rows, cols), row 0 at the lowest y, of an image with its top row first, and warnings."""
    table = _log_odds_of_gray(settings)
    log_odds = np.where(opaque, table[gray], np.float32(0.0))[::-1]
    if settings.mode is not MapMode.TRINARY or table[UNKNOWN_GRAY] == 0.0:
        return log_odds, ()
    count = int((opaque & (gray == UNKNOWN_GRAY)).sum())
    if count == 0:
        return log_odds, ()
    state = "free" if table[UNKNOWN_GRAY] < 0.0 else "occupied"
    warning = (
        f"{count} cells of grey {UNKNOWN_GRAY}, usually unknown, are {state} with free_thresh {settings.free_thresh}, "
        f"negate {int(settings.negate)}: if they are unknown, set free_thresh to {FREE_THRESHOLD} and negate to 0"
    )
    return log_odds, (warning,)


def _log_odds_of_gray(settings: MapYaml) -> LogOdds:
    """Return the log-odds (256,) of every brightness, 0 where it means unknown."""
    gray = np.arange(256)
    p = gray / 255.0 if settings.negate else 1.0 - gray / 255.0
    occupied, free = p >= settings.occupied_thresh, p <= settings.free_thresh
    if settings.mode is MapMode.RAW:
        percent, known = gray.astype(np.float64), gray <= 100
    else:
        between = (p - settings.free_thresh) / (settings.occupied_thresh - settings.free_thresh)
        percent = np.where(occupied, 100.0, np.where(free, 0.0, np.rint(between * 100.0)))
        known = occupied | free if settings.mode is MapMode.TRINARY else np.ones(256, dtype=np.bool_)
    p = np.clip(percent / 100.0, FREE_PROBABILITY, OCCUPIED_PROBABILITY)
    log_odds = np.where(percent == 50.0, _UNDECIDED_LOG_ODDS, np.log(p / (1.0 - p)))
    return np.where(known, log_odds, 0.0).astype(np.float32)


def _to_pixels(grid: OccupancyGrid, mode: MapMode) -> ByteImage:
    """Return the pixels (rows, cols), or (rows, cols, 4) in mode scale, top row first."""
    if mode is MapMode.TRINARY:
        pixels = np.where(grid.occupied, OCCUPIED_GRAY, np.where(grid.free, FREE_GRAY, UNKNOWN_GRAY))
        return np.ascontiguousarray(pixels[::-1], dtype=np.uint8)
    percent = np.rint(grid.probability * 100.0)
    if mode is MapMode.RAW:
        return np.ascontiguousarray(np.where(grid.known, percent, RAW_UNKNOWN)[::-1], dtype=np.uint8)
    gray = np.where(grid.known, np.rint((100.0 - percent) / 100.0 * 255.0), 128.0)
    pixels = np.dstack([gray, gray, gray, np.where(grid.known, 255.0, 0.0)])
    return np.ascontiguousarray(pixels[::-1], dtype=np.uint8)


def _stated_white(data: bytes, white: int) -> int:
    """Return the pixel value that a PGM or PPM states as white; OpenCV scales text ones of 8 bits itself, no others."""
    gap = rb"(?:\s|#[^\n]*\n)+"
    header = re.match(rb"P([2356])" + gap + rb"\d+" + gap + rb"\d+" + gap + rb"(\d+)", data)
    if header is None or (header[1] in b"23" and white == 255):
        return white
    return int(header[2])
