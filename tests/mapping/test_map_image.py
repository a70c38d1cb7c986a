from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from mapping.errors import MapFileError
from mapping.grid import OccupancyGrid
from mapping.map_image import decode_image, encode_image, to_log_odds
from mapping.map_yaml import MapMode, MapYaml

HERE = Path("map.pgm")
GRAY, RGB, GRAY_ALPHA, RGBA = 0, 2, 4, 6  # colour types of PNG


def png(width: int, height: int, colour_type: int, samples: list[int], depth: int = 8) -> bytes:
    """Return a PNG built by hand (RFC 2083): samples row by row, top row first."""
    raw = np.array(samples, dtype=">u2" if depth == 16 else "u1").reshape(height, -1)
    lines = b"".join(b"\0" + row.tobytes() for row in raw)

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


def yaml(mode: MapMode = MapMode.TRINARY, *, negate: bool = False, free: float = 0.196) -> MapYaml:
    return MapYaml(HERE, mode, 0.05, (0.0, 0.0, 0.0), negate, 0.65, free)


def probabilities(grays: list[int], settings: MapYaml) -> list[float]:
    gray = np.array([grays], dtype=np.uint8)
    log_odds, _ = to_log_odds(gray, np.ones(gray.shape, np.bool_), settings)
    return [round(float(p), 4) for p in 1.0 / (1.0 + np.exp(-log_odds[0].astype(float)))]


# Decoding


@pytest.mark.parametrize(
    "data",
    [
        b"P5\n3 2\n255\n" + bytes([0, 100, 205, 254, 1, 2]),
        b"P5 # by someone\n# twice\n3\n2 255\n" + bytes([0, 100, 205, 254, 1, 2]),
        b"P2\n# comment\n3 2\n255\n0 100 205\n254 1 2\n",
        b"P6\n3 2\n255\n" + bytes([value for gray in (0, 100, 205, 254, 1, 2) for value in (gray, gray, gray)]),
        png(3, 2, GRAY, [0, 100, 205, 254, 1, 2]),
        png(3, 2, RGB, [value for gray in (0, 100, 205, 254, 1, 2) for value in (gray, gray, gray)]),
        png(3, 2, GRAY_ALPHA, [value for gray in (0, 100, 205, 254, 1, 2) for value in (gray, 255)]),
        png(3, 2, RGBA, [value for gray in (0, 100, 205, 254, 1, 2) for value in (gray, gray, gray, 255)]),
    ],
    ids=["P5", "P5 comments", "P2", "P6", "gray png", "rgb png", "gray alpha png", "rgba png"],
)
def test_gray_values_are_read_from_every_kind_of_image(data: bytes) -> None:
    gray, opaque = decode_image(data, HERE)
    assert gray.tolist() == [[0, 100, 205], [254, 1, 2]]
    assert opaque.all()


def test_transparency_is_told_apart() -> None:
    samples = [10, 10, 10, 255, 10, 10, 10, 254, 128, 128, 128, 0]
    _, opaque = decode_image(png(3, 1, RGBA, samples), HERE)
    assert opaque.tolist() == [[True, False, False]]
    _, opaque = decode_image(png(2, 1, GRAY_ALPHA, [7, 65535, 7, 65534], depth=16), HERE)
    assert opaque.tolist() == [[True, False]]


def test_colours_count_by_their_luma() -> None:
    gray, _ = decode_image(b"P6\n3 1\n255\n" + bytes([255, 0, 0, 0, 255, 0, 0, 0, 255]), HERE)
    assert gray.tolist() == [[76, 150, 29]]  # 255 * (0.299, 0.587, 0.114), ITU-R BT.601


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"P5\n3 1\n100\n" + bytes([0, 50, 100]), [0, 128, 255]),
        (b"P2\n3 1\n100\n0 20 100\n", [0, 51, 255]),
        (b"P5\n3 1\n65535\n" + struct.pack(">3H", 0, 205 * 257, 65535), [0, 205, 255]),
        (b"P5\n3 1\n1000\n" + struct.pack(">3H", 0, 200, 1000), [0, 51, 255]),
        (b"P2\n3 1\n1000\n0 200 1000\n", [0, 51, 255]),
        (png(3, 1, GRAY, [0, 205 * 257, 65535], depth=16), [0, 205, 255]),
    ],
    ids=["P5 of 100", "P2 of 100", "16-bit P5", "P5 of 1000", "P2 of 1000", "16-bit png"],
)
def test_other_depths_are_scaled_to_eight_bits(data: bytes, expected: list[int]) -> None:
    gray, _ = decode_image(data, HERE)
    # Half of 100 is 127.5, which may be rounded either way.
    assert np.abs(gray[0].astype(int) - expected).max() <= (1 if 128 in expected else 0)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"hello",
        b"P5\n30 20\n255\n" + bytes(10),
        b"P5\n0 0\n255\n",
        b"P5\n2 2\n0\n" + bytes(4),
        png(40, 40, GRAY, [7] * 1600)[:-30],
        b"GIF89a",
    ],
    ids=["empty", "text", "cut PGM", "no pixels", "no range", "cut PNG", "other"],
)
def test_what_is_no_whole_image_is_refused_in_one_line(data: bytes) -> None:
    with pytest.raises(MapFileError, match=f"map.pgm: {len(data)} bytes") as caught:
        decode_image(data, HERE)
    assert "\n" not in str(caught.value)


# Meaning


def test_trinary_knows_three_values() -> None:
    grays = [0, 89, 90, 204, 205, 206, 254, 255]  # p = 1, 0.651, 0.647, 0.2, 0.19608, 0.192, 0.004, 0
    assert probabilities(grays, yaml()) == [0.996, 0.996, 0.5, 0.5, 0.5, 0.004, 0.004, 0.004]
    assert probabilities(grays, yaml(negate=True)) == [0.004, 0.5, 0.5, 0.996, 0.996, 0.996, 0.996, 0.996]


def test_at_a_threshold_counts_as_beyond_it() -> None:
    settings = MapYaml(HERE, MapMode.TRINARY, 0.05, (0.0, 0.0, 0.0), True, occupied_thresh=0.8, free_thresh=0.2)
    assert probabilities([51, 52, 203, 204], settings) == [0.004, 0.5, 0.5, 0.996]  # 51 / 255 = 0.2, 204 / 255 = 0.8


def test_scale_stretches_what_lies_between_the_thresholds() -> None:
    # round((p - 0.196) / (0.65 - 0.196) * 100) as in nav2, so 40 % written as grey 153 comes back as 45 %.
    assert probabilities([0, 89, 153, 255], yaml(MapMode.SCALE)) == [0.996, 0.996, 0.45, 0.004]
    assert probabilities([102], yaml(MapMode.SCALE, negate=True)) == [0.45]


def test_scale_is_unknown_where_transparent_only() -> None:
    gray, opaque = np.array([[0, 0, 147]], np.uint8), np.array([[True, False, True]])
    log_odds, _ = to_log_odds(gray, opaque, yaml(MapMode.SCALE))
    assert (log_odds != 0.0).tolist() == [[True, False, True]]  # 147 is 50 %: known, and undecided


def test_raw_is_per_cent_whatever_negate_says() -> None:
    for negate in (False, True):
        settings = yaml(MapMode.RAW, negate=negate)
        assert probabilities([0, 40, 99, 100, 101, 255], settings) == [0.004, 0.4, 0.99, 0.996, 0.5, 0.5]


def test_unknown_is_exactly_zero_and_known_never() -> None:
    gray = np.arange(256, dtype=np.uint8)[np.newaxis]
    for mode, known in ((MapMode.RAW, 101), (MapMode.SCALE, 256)):
        log_odds, _ = to_log_odds(gray, np.ones(gray.shape, np.bool_), yaml(mode))
        assert np.count_nonzero(log_odds) == known
    trinary, _ = to_log_odds(gray, np.ones(gray.shape, np.bool_), yaml())
    assert np.flatnonzero(trinary[0] == 0.0).tolist() == list(range(90, 206))


def test_transparent_pixels_are_unknown_in_every_mode() -> None:
    for mode in MapMode:
        log_odds, _ = to_log_odds(np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.bool_), yaml(mode))
        assert log_odds.tolist() == [[0.0]]


@pytest.mark.parametrize(
    ("settings", "state"), [(yaml(free=0.25), "free"), (yaml(negate=True), "occupied")], ids=["free", "negate"]
)
def test_the_grey_that_means_unknown_is_warned_of_where_it_does_not(settings: MapYaml, state: str) -> None:
    gray = np.array([[205, 205, 0, 254, 205]], np.uint8)
    opaque = np.array([[True, True, True, True, False]])
    log_odds, warnings = to_log_odds(gray, opaque, settings)
    assert (log_odds[0, :2] != 0.0).all()
    assert len(warnings) == 1
    assert f"2 cells of grey 205, usually unknown, are {state}" in warnings[0]


def test_harmless_images_are_not_warned_of() -> None:
    with_unknown, without = np.array([[205, 0, 254]], np.uint8), np.array([[0, 254, 255]], np.uint8)
    opaque = np.ones((1, 3), np.bool_)
    assert to_log_odds(with_unknown, opaque, yaml())[1] == ()
    assert to_log_odds(without, opaque, yaml(free=0.25))[1] == ()
    assert to_log_odds(with_unknown, opaque, yaml(MapMode.SCALE, free=0.25))[1] == ()


# Orientation and encoding


def corner_grid() -> OccupancyGrid:
    """Return 2 rows x 3 columns: occupied at the lowest x and y, free at the highest x and lowest y, else unknown."""
    return OccupancyGrid(np.array([[4.0, 0.0, -4.0], [0.0, 0.0, 0.0]], np.float32), 0.05, np.zeros(3))


def test_row_0_of_the_image_is_the_highest_y() -> None:
    pgm = encode_image(corner_grid(), MapMode.TRINARY, "pgm")
    assert pgm.startswith(b"P5\n3 2\n255\n")
    assert list(pgm[-6:]) == [205, 205, 205, 0, 205, 254]
    log_odds, _ = to_log_odds(*decode_image(pgm, HERE), yaml())
    assert np.sign(log_odds).tolist() == [[1, 0, -1], [0, 0, 0]]


@pytest.mark.parametrize(
    ("mode", "pixels"),
    [
        (MapMode.TRINARY, [0, 205, 205, 205, 254, 205]),
        (MapMode.RAW, [90, 60, 50, 40, 10, 255]),
    ],
)
def test_pixels_are_those_of_nav2(mode: MapMode, pixels: list[int]) -> None:
    p = np.array([[0.9, 0.6, 0.5001, 0.4, 0.1, 0.5]])
    grid = OccupancyGrid(np.log(p / (1 - p)).astype(np.float32), 0.05, np.zeros(3))
    assert list(encode_image(grid, mode, "pgm")[-6:]) == pixels


def test_scale_writes_brightness_and_transparency() -> None:
    p = np.array([[0.9, 0.6, 0.4, 0.1, 0.5]])
    grid = OccupancyGrid(np.log(p / (1 - p)).astype(np.float32), 0.05, np.zeros(3))
    gray, opaque = decode_image(encode_image(grid, MapMode.SCALE, "png"), HERE)
    # (100 - v) / 100 of 255; 10 % of it is 25.5, rounded to even.
    np.testing.assert_allclose(gray[0, :4], [25.5, 102, 153, 229.5], atol=0.51)
    assert opaque.tolist() == [[True, True, True, True, False]]
