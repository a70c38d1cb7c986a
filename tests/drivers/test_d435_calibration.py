from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.d435_calibration import (
    CalibrationError,
    CalibrationSource,
    cropped,
    file_calibration,
    nominal_pinhole,
    parse_coefficients,
    parse_rectification,
    pinhole_for,
    read_calibration,
    scaled,
)
from drivers.d435_hardware_monitor import HardwareMonitorError
from drivers.errors import DeviceLostError, DriverError
from drivers.messages import Pinhole

FULL = Pinhole(1920, 1080, 964.0, 963.0, 961.5, 541.25)
SIZES = [(1280, 720), (848, 480), (640, 480), (640, 360), (480, 270), (424, 240), (848, 100), (256, 144)]


def table(rows: dict[int, tuple[float, float, float, float]], length: int = 512) -> bytes:
    """Table 25 byte by byte: rows at 256 + 16 place, CRC-32 of all behind the header at 12."""
    data = bytearray(length)
    for place, row in rows.items():
        struct.pack_into("<ffff", data, 256 + 16 * place, *row)
    struct.pack_into("<I", data, 12, zlib.crc32(data[16:]))
    return bytes(data)


class Firmware:
    """Answers with what it was given; an exception is raised."""

    def __init__(self, rectification: object = None, coefficients: object = None, unit: object = 0.0005) -> None:
        refusal = HardwareMonitorError("cam: the camera refuses", -1)
        self._answers = [refusal if each is None else each for each in (rectification, coefficients, unit)]

    def _answer(self, place: int):
        answer = self._answers[place]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def rectification(self) -> bytes:
        return self._answer(0)

    def coefficients(self) -> bytes:
        return self._answer(1)

    def depth_unit_m(self) -> float:
        return self._answer(2)


def test_rectification_rows_are_found_by_their_size():
    payload = struct.pack("<HHffff", 848, 480, 425.0, 424.0, 427.5, 239.5)
    payload += struct.pack("<HHffff", 640, 480, 385.5, 385.0, 322.0, 237.5)
    rows = parse_rectification(payload + b"\x01\x02")
    assert rows == {
        (848, 480): Pinhole(848, 480, 425.0, 424.0, 427.5, 239.5),
        (640, 480): Pinhole(640, 480, 385.5, 385.0, 322.0, 237.5),
    }


@pytest.mark.parametrize("row", [(0, 0, 0, 0), (7, 7, 9, 9), (-5, 5, 9, 9), (5, 4, 900, 9), (float("nan"), 5, 9, 9)])
def test_rows_without_calibration_are_left_out(row):
    assert parse_rectification(struct.pack("<HHffff", 848, 480, *row)) == {}
    assert parse_coefficients(table({3: row})) == {}


def test_table_rows_lie_in_the_published_order():
    rows = parse_coefficients(table({3: (425.0, 424.0, 427.5, 239.5), 15: (9.0, 8.0, 7.0, 6.0)}))
    assert rows == {
        (848, 480): Pinhole(848, 480, 425.0, 424.0, 427.5, 239.5),
        (1152, 1152): Pinhole(1152, 1152, 9.0, 8.0, 7.0, 6.0),
    }


@pytest.mark.parametrize("length", [512, 448, 576])
def test_a_table_is_read_by_its_length(length):
    assert (848, 480) in parse_coefficients(table({3: (425.0, 424.0, 427.5, 239.5)}, length))


@given(st.integers(12, 511), st.integers(1, 255))
def test_a_flipped_byte_never_passes(place, flip):
    data = bytearray(table({3: (425.0, 424.0, 427.5, 239.5)}))
    data[place] ^= flip
    with pytest.raises(CalibrationError, match=r"CRC-32 [0-9A-F]{8}, expected [0-9A-F]{8}"):
        parse_coefficients(bytes(data))


def test_a_cut_table_is_refused():
    with pytest.raises(CalibrationError, match="table of 200 bytes, expected 512"):
        parse_coefficients(bytes(200))


def test_scaling_back_and_forth_changes_nothing_and_keeps_the_corners():
    small = scaled(FULL, (480, 270))
    assert small.fx == FULL.fx / 4
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(scaled(small, (1920, 1080)), name) == pytest.approx(getattr(FULL, name))
    left = (-0.5 - FULL.cx) / FULL.fx  # ray through the left edge of the image
    assert (-0.5 - small.cx) / small.fx == pytest.approx(left)
    right = (1919.5 - FULL.cx) / FULL.fx
    assert (479.5 - small.cx) / small.fx == pytest.approx(right)


def test_modes_cut_out_of_another_move_the_principal_point_only():
    wide = Pinhole(848, 480, 425.0, 424.0, 427.5, 239.5)
    assert pinhole_for({(848, 480): wide}, (848, 100)) == Pinhole(848, 100, 425.0, 424.0, 427.5, 49.5)
    assert pinhole_for({(1920, 1080): FULL}, (256, 144)) == Pinhole(256, 144, 964.0, 963.0, 129.5, 73.25)


def test_an_unknown_mode_is_scaled_from_the_largest_row_and_cut():
    rows = {(1920, 1080): FULL, (848, 480): Pinhole(848, 480, 1.0, 2.0, 3.0, 4.0)}
    assert pinhole_for(rows, (960, 540)) == scaled(FULL, (960, 540))
    square = pinhole_for(rows, (540, 540))
    assert square.fx == FULL.fx / 2
    assert square.cx == pytest.approx((FULL.cx + 0.5) / 2 - 0.5 - (960 - 540) / 2)
    with pytest.raises(CalibrationError, match="no calibrated image size"):
        pinhole_for({}, (848, 480))


@pytest.mark.parametrize("size", SIZES)
def test_nominal_values_are_those_of_a_real_camera_within_a_few_per_cent(size):
    """Real: 640x480 385.6 (QCar 2), 848x480 about 425, both seeing 87 +- 3 deg at full width."""
    camera = nominal_pinhole(size)
    assert (camera.width, camera.height) == size
    assert camera.fx == camera.fy
    real = {(640, 480): 385.6, (848, 480): 425.0, (848, 100): 425.0}
    assert camera.fx == pytest.approx(real.get(size, camera.fx), rel=0.01)
    assert camera.cx == pytest.approx((size[0] - 1) / 2, abs=1.0)
    assert camera.cy == pytest.approx((size[1] - 1) / 2, abs=1.0)


def test_the_real_camera_of_the_recorded_bag_is_near_nominal():
    assert nominal_pinhole((640, 480)).fx == pytest.approx(390.43, rel=0.02)  # factory value of another D435


RECTIFICATION = struct.pack("<HHffff", 848, 480, 425.0, 424.0, 427.5, 239.5)
TABLE = table({3: (430.0, 429.0, 420.0, 230.0)})
BROKEN = TABLE[:-1] + b"\x01"


@pytest.mark.parametrize(
    ("firmware", "source", "fx", "notes"),
    [
        (Firmware(RECTIFICATION, TABLE), CalibrationSource.RECTIFICATION, 425.0, 0),
        (Firmware(None, TABLE), CalibrationSource.TABLE, 430.0, 1),
        (Firmware(b"", TABLE), CalibrationSource.TABLE, 430.0, 1),
        (Firmware(None, BROKEN), CalibrationSource.NOMINAL, 425.7, 2),
        (Firmware(None, None), CalibrationSource.NOMINAL, 425.7, 2),
    ],
)
def test_the_best_source_that_answers_is_used_and_named(firmware, source, fx, notes):
    calibration = read_calibration(firmware, (848, 480), None)
    assert calibration.source is source
    assert calibration.camera.fx == pytest.approx(fx, abs=0.1)
    assert calibration.unit_m == 0.0005
    assert len(calibration.notes) == notes


def camera_info(folder: Path, distortion: float = 0.0) -> Path:
    path = folder / "camera.yaml"
    path.write_text(
        "image_width: 640\nimage_height: 480\n"
        "camera_matrix: {rows: 3, cols: 3, data: [500, 0, 319.5, 0, 500, 239.5, 0, 0, 1]}\n"
        f"distortion_coefficients: {{rows: 1, cols: 5, data: [{distortion}, 0, 0, 0, 0]}}\n",
        encoding="utf-8",
    )
    return path


def test_the_file_comes_before_nominal_values_and_after_the_camera(tmp_path):
    path = camera_info(tmp_path)
    from_file = read_calibration(Firmware(None, BROKEN), (320, 240), path)
    assert from_file.source is CalibrationSource.FILE
    assert from_file.camera == Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
    assert [note.partition(" not used")[0] for note in from_file.notes] == [
        CalibrationSource.RECTIFICATION.value,
        CalibrationSource.TABLE.value,
    ]
    assert read_calibration(Firmware(RECTIFICATION), (848, 480), path).source is CalibrationSource.RECTIFICATION


def test_distortion_is_told_and_another_shape_refused(tmp_path):
    path = camera_info(tmp_path, distortion=0.1)
    assert "distortion" in file_calibration(path, (640, 480)).notes[0]
    with pytest.raises(DriverError, match="640x480, which does not scale to 848x480"):
        file_calibration(path, (848, 480))


def test_an_unknown_unit_is_a_millimetre_and_said_so():
    calibration = read_calibration(Firmware(RECTIFICATION, unit=HardwareMonitorError("no", -1)), (848, 480), None)
    assert calibration.unit_m == 0.001
    assert "assumed" in calibration.notes[0]


def test_a_lost_camera_is_not_taken_for_an_uncalibrated_one():
    with pytest.raises(DeviceLostError):
        read_calibration(Firmware(DeviceLostError("gone")), (848, 480), None)


def test_cropping_keeps_rays():
    part = cropped(FULL, (1000, 500))
    assert (0 - part.cx) / part.fx == pytest.approx((460 - FULL.cx) / FULL.fx)
    assert (0 - part.cy) / part.fy == pytest.approx((290 - FULL.cy) / FULL.fy)
