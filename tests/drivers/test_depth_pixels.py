from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.depth_pixels import compressed_counts, metres_to_counts, png_counts, raw_counts

COUNTS = np.random.default_rng(1).integers(0, 65536, (5, 7), dtype=np.uint16)


def png(pixels):
    return cv2.imencode(".png", pixels)[1].tobytes()


def padded(pixels, padding):
    """Rows of bytes with `padding` bytes behind each but the last."""
    rows = [row.tobytes() + b"\xee" * padding for row in pixels]
    return np.frombuffer(b"".join(rows)[: len(b"".join(rows)) - padding], np.uint8)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 1, 6])
def test_raw_counts_survive_byte_order_and_row_step(encoding, big, padding):
    data = padded(COUNTS.astype(">u2" if big else "<u2"), padding)
    assert np.array_equal(raw_counts(encoding, (5, 7), 14 + padding, data, big=big), COUNTS)


@pytest.mark.parametrize("big", [False, True])
def test_metres_become_millimetres_and_what_is_no_depth_zero(big):
    metres = np.array([[0.0, 1.2344, 1.2346], [np.nan, np.inf, -1.0], [65.535, 65.6, 0.0004]])
    data = padded(metres.astype(">f4" if big else "<f4"), 4)
    counts = raw_counts("32FC1", (3, 3), 16, data, big=big)
    assert counts.tolist() == [[0, 1234, 1235], [0, 0, 0], [65535, 0, 0]]


@pytest.mark.parametrize(
    ("encoding", "size", "step", "message"),
    [
        ("rgb8", (5, 7), 14, "encoding 'rgb8', expected 16UC1, mono16, 32FC1"),
        ("16UC1", (6, 7), 14, "70 bytes in steps of 14 are no 7x6 image"),
        ("16UC1", (5, 7), 13, "no 7x5 image"),
        ("16UC1", (0, 7), 14, "no 7x0 image"),
    ],
)
def test_what_is_no_image_is_refused(encoding, size, step, message):
    with pytest.raises(ValueError, match=message):
        raw_counts(encoding, size, step, COUNTS.view(np.uint8).ravel(), big=False)


def test_rvl_is_read_as_counts_and_as_inverse_depth():
    rvl = struct.pack("<ii", 5, 1) + bytes.fromhex("0021a122")  # pixels 0, 0, 5, 6, 0
    counts = compressed_counts("16UC1; compressedDepth rvl", struct.pack("<iff", 1, 0, 0) + rvl)
    assert counts.tolist() == [[0, 0, 5, 6, 0]]
    metres = compressed_counts("32FC1; compressedDepth rvl", struct.pack("<iff", 1, 8.0, 1.0) + rvl)
    assert metres.tolist() == [[0, 0, 2000, 1600, 0]]


@pytest.mark.parametrize(
    "image_format", ["16UC1; compressedDepth", "16UC1; compressedDepth png", "mono16;compressedDepth"]
)
def test_compressed_counts_survive(image_format):
    assert np.array_equal(compressed_counts(image_format, struct.pack("<iff", 0, 0, 0) + png(COUNTS)), COUNTS)


def test_inverse_depth_is_undone():
    # As the transport's encoder: a = q (q + 1), b = 1 - a / depth_max; pixel = a / depth + b.
    quantization, depth_max = 100.0, 10.0
    a = quantization * (quantization + 1)
    b = 1 - a / depth_max
    metres = np.linspace(0.5, 9.9, 35, dtype=np.float32).reshape(5, 7)
    pixels = (a / metres + b).astype(np.uint16)
    pixels[0, 0] = 0

    counts = compressed_counts("32FC1; compressedDepth", struct.pack("<iff", 0, a, b) + png(pixels))

    step_m = metres**2 / a  # of one count of the inverse depth
    assert counts[0, 0] == 0
    assert (np.abs(counts * 0.001 - metres).ravel()[1:] <= step_m.ravel()[1:] * 1.05 + 0.0005).all()


@pytest.mark.parametrize(
    ("image_format", "data", "message"),
    [
        ("rgb8; jpeg compressed bgr8", b"x" * 20, "expected compressedDepth"),
        ("8UC1; compressedDepth", bytes(12) + png(COUNTS), "not 16UC1 or 32FC1"),
        ("16UC1; compressedDepth", bytes(12), "12 bytes, too few"),
        ("16UC1; compressedDepth", bytes(32), "no PNG"),
    ],
)
def test_other_compressed_images_are_refused(image_format, data, message):
    with pytest.raises(ValueError, match=message):
        compressed_counts(image_format, data)


def test_png_of_another_depth_or_cut_or_damaged_is_refused_without_a_word_to_stderr(capfd):
    data = png(COUNTS)
    with pytest.raises(ValueError, match="not of one grey channel of 16 bits"):
        png_counts(png(np.zeros((3, 3), np.uint8)))
    for cut in range(len(data)):
        with pytest.raises(ValueError, match="PNG"):
            png_counts(data[:cut])
    for place in range(8, len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 0x10
        with pytest.raises(ValueError, match="PNG"):
            png_counts(bytes(damaged))
    assert capfd.readouterr().err == ""


@given(st.lists(st.floats(width=32), min_size=1, max_size=50))
def test_any_float_becomes_a_count(values):
    metres = np.array(values, np.float32)
    counts = metres_to_counts(metres)
    far = np.isfinite(metres) & (metres > 0.0006) & (metres < 65.5)
    assert np.abs(counts[far] * 0.001 - metres[far]).max(initial=0) <= 0.000501
    assert (counts[~(metres > 0)] == 0).all()
