"""Intrinsics of a RealSense D400 depth image and what they were taken from.

Depth is rectified by the camera, so a pinhole without distortion describes it; it is seen from the left imager. Pure
functions of the bytes that drivers.d435_hardware_monitor brings. Layouts from librealsense (d400-private.h).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Protocol

from drivers.camera_info import read_camera_info
from drivers.errors import DeviceFaultError, DriverError
from drivers.messages import Pinhole

Size = tuple[int, int]  # width, height
Rows = Mapping[Size, Pinhole]

# Sizes of the sixteen rows of table 25, in their order; None where the row is not used.
TABLE_SIZES: tuple[Size | None, ...] = (
    (1920, 1080), (1280, 720), (640, 480), (848, 480), (640, 360), (424, 240), (320, 240), (480, 270),
    (1280, 800), (960, 540), None, None, (640, 400), (576, 576), (720, 720), (1152, 1152),
)  # fmt: skip
TABLE_HEADER = struct.Struct("<HHIII")  # version (big-endian, not needed), type, size, parameter, CRC-32
TABLE_ROWS_AT = 256  # after the header, two imagers' matrices, baseline and reserved bytes
TABLE_ROW = struct.Struct("<ffff")  # fx, fy, cx, cy
RECTIFICATION_ROW = struct.Struct("<HHffff")  # width, height, fx, fy, cx, cy

DEFAULT_UNIT_M = 0.001
_FULL_SIZE = (1920, 1080)
_CROPPED_FROM = {(848, 100): (848, 480), (256, 144): _FULL_SIZE}  # these modes cut the middle out of another
# An unmodified D435 (a QCar 2's): 385.6 px at 640x480, which the camera makes from 1280x800 at scale 0.6.
_NOMINAL_FOCAL_PX = 385.6 / 0.6
_IMAGER_WIDTH, _IMAGER_HEIGHT = 1280, 800
_WIDE = 1.7  # 16:9 modes use the imager's whole width, others its whole height


class CalibrationSource(str, Enum):
    """Where intrinsics come from, best first."""

    RECTIFICATION = "the camera's rectification parameters"
    TABLE = "the camera's calibration table"
    FILE = "the camera_info file"
    NOMINAL = "nominal values of a D435"


class CalibrationError(DeviceFaultError):
    """Calibration data are damaged or hold no usable row."""


@dataclass(frozen=True, slots=True)
class DepthCalibration:
    """What turns counts into points. notes: why better sources were not used, one line each."""

    camera: Pinhole
    unit_m: float
    source: CalibrationSource
    notes: tuple[str, ...] = ()


class CalibratedCamera(Protocol):
    """Answers of a camera's firmware; see drivers.d435_hardware_monitor. Each may raise DeviceFaultError."""

    def rectification(self) -> bytes:
        """Return intrinsics per image size."""
        ...

    def coefficients(self) -> bytes:
        """Return calibration table 25."""
        ...

    def depth_unit_m(self) -> float:
        """Metres per count."""
        ...


def read_calibration(monitor: CalibratedCamera, size: Size, camera_info: Path | None) -> DepthCalibration:
    """Ask the camera for intrinsics at `size` and its depth unit; else the file, else nominal values of a D435.

    Raises DeviceLostError, and RecordingError for a file that is needed and cannot be read.
    """
    notes: list[str] = []
    unit_m = DEFAULT_UNIT_M
    try:
        unit_m = monitor.depth_unit_m()
    except DeviceFaultError as error:
        notes.append(f"depth unit assumed to be {DEFAULT_UNIT_M:g} m: {error}")
    sources: tuple[tuple[CalibrationSource, Callable[[], Rows]], ...] = (
        (CalibrationSource.RECTIFICATION, lambda: parse_rectification(monitor.rectification())),
        (CalibrationSource.TABLE, lambda: parse_coefficients(monitor.coefficients())),
    )
    for source, rows in sources:
        try:
            return DepthCalibration(pinhole_for(rows(), size), unit_m, source, tuple(notes))
        except DeviceFaultError as error:
            notes.append(f"{source.value} not used: {error}")
    if camera_info is not None:
        from_file = file_calibration(camera_info, size, unit_m)
        return replace(from_file, notes=(*notes, *from_file.notes))
    return DepthCalibration(nominal_pinhole(size), unit_m, CalibrationSource.NOMINAL, tuple(notes))


def file_calibration(path: Path, size: Size, unit_m: float = DEFAULT_UNIT_M) -> DepthCalibration:
    """Return what a camera_info file says, scaled to `size`; raises RecordingError, DriverError for another shape."""
    info = read_camera_info(path)
    given = info.camera
    if given.width * size[1] != given.height * size[0]:
        raise DriverError(
            f"{path}: calibrated at {given.width}x{given.height}, which does not scale to {size[0]}x{size[1]}:"
            " choose a mode of the same shape, or calibrate this one"
        )
    notes = (f"{path}: distortion coefficients are ignored",) if info.distorted else ()
    return DepthCalibration(scaled(given, size), unit_m, CalibrationSource.FILE, notes)


def parse_rectification(payload: bytes) -> Rows:
    """Read the array of (width, height, fx, fy, cx, cy); unusable rows are left out, so is a cut one at the end."""
    whole = len(payload) - len(payload) % RECTIFICATION_ROW.size
    rows = (Pinhole(*fields) for fields in RECTIFICATION_ROW.iter_unpack(payload[:whole]))
    return {(row.width, row.height): row for row in rows if _usable(row)}


def parse_coefficients(payload: bytes) -> Rows:
    """Read table 25, of whatever length; raises CalibrationError where it is cut or its CRC-32 is wrong."""
    if len(payload) < TABLE_ROWS_AT + TABLE_ROW.size:
        raise CalibrationError(
            f"calibration table of {len(payload)} bytes, expected 512: recalibrate the camera with the vendor's tool"
        )
    *_, expected = TABLE_HEADER.unpack_from(payload)
    found = zlib.crc32(payload[TABLE_HEADER.size :])
    if found != expected:
        raise CalibrationError(
            f"calibration table with CRC-32 {found:08X}, expected {expected:08X}:"
            " recalibrate the camera with the vendor's tool"
        )
    rows: dict[Size, Pinhole] = {}
    for place, size in enumerate(TABLE_SIZES):
        start = TABLE_ROWS_AT + place * TABLE_ROW.size
        if size is None or start + TABLE_ROW.size > len(payload):
            continue
        row = Pinhole(*size, *TABLE_ROW.unpack_from(payload, start))
        if _usable(row):
            rows[size] = row
    return rows


def pinhole_for(rows: Rows, size: Size) -> Pinhole:
    """Return the row of `size`, else one made from another as the camera makes the image; raises CalibrationError."""
    if size in rows:
        return rows[size]
    if not rows:
        raise CalibrationError("no calibrated image size: recalibrate the camera with the vendor's tool")
    whole = _CROPPED_FROM.get(size)
    if whole is not None and whole in rows:
        return cropped(rows[whole], size)
    largest = rows.get(_FULL_SIZE) or max(rows.values(), key=lambda row: row.width * row.height)
    factor = max(size[0] / largest.width, size[1] / largest.height)
    covering = (round(largest.width * factor), round(largest.height * factor))
    return cropped(scaled(largest, covering), size)


def nominal_pinhole(size: Size) -> Pinhole:
    """Return what an average D435 has, with the axis through the middle: a few per cent off in focal length."""
    if size in _CROPPED_FROM:
        return cropped(nominal_pinhole(_CROPPED_FROM[size]), size)
    width, height = size
    scale = width / _IMAGER_WIDTH if width > _WIDE * height else height / _IMAGER_HEIGHT
    focal = _NOMINAL_FOCAL_PX * scale
    return Pinhole(*size, focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2)


def scaled(camera: Pinhole, size: Size) -> Pinhole:
    """Return the camera of the same image at another size; the middle of the first pixel moves, its corner does not."""
    x, y = size[0] / camera.width, size[1] / camera.height
    return Pinhole(*size, camera.fx * x, camera.fy * y, (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5)


def cropped(camera: Pinhole, size: Size) -> Pinhole:
    """Return the camera of the middle of the image."""
    left, top = (camera.width - size[0]) / 2, (camera.height - size[1]) / 2
    return Pinhole(*size, camera.fx, camera.fy, camera.cx - left, camera.cy - top)


def _usable(row: Pinhole) -> bool:
    """Whether a row is calibrated: firmware fills the others with equal numbers, zeros among them."""
    numbers = (row.fx, row.fy, row.cx, row.cy)
    if not all(math.isfinite(number) for number in numbers) or (row.fx == row.fy and row.cx == row.cy):
        return False
    return row.fx > 0 and row.fy > 0 and 0 < row.cx < row.width and 0 < row.cy < row.height
