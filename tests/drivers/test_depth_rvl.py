from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from drivers.depth_rvl import rvl_counts


def nibbles_of(number):
    """A number as the paper's EncodeVLE writes it."""
    while True:
        low, number = number & 7, number >> 3
        yield low | (8 if number else 0)
        if not number:
            return


def encoded(pixels):
    """RVL by its definition, a pixel at a time, with the size that ROS puts in front."""
    flat, nibbles, place, previous = pixels.ravel().tolist(), list[int](), 0, 0
    while place < len(flat):
        first = next((n for n in range(place, len(flat)) if flat[n]), len(flat))
        end = next((n for n in range(first, len(flat)) if not flat[n]), len(flat))
        nibbles += [*nibbles_of(first - place), *nibbles_of(end - first)]
        for pixel in flat[first:end]:
            difference = pixel - previous
            nibbles += nibbles_of(2 * difference if difference >= 0 else -2 * difference - 1)
            previous = pixel
        place = end
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[n : n + 8]), 16) for n in range(0, len(nibbles), 8)]
    return struct.pack(f"<ii{len(words)}I", pixels.shape[1], pixels.shape[0], *words)


def test_a_vector_by_hand():
    data = struct.pack("<ii", 5, 1) + bytes.fromhex("0021a122")  # 2 zeros, 2 others: +5 (10 = 2 | 1 << 3), +1; 1 zero
    assert rvl_counts(data).tolist() == [[0, 0, 5, 6, 0]]
    assert encoded(np.array([[0, 0, 5, 6, 0]], np.uint16)) == data


@given(
    arrays(
        np.uint16,
        array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.one_of(st.just(0), st.integers(0, 65535)),
    )
)
def test_decoding_undoes_encoding(pixels):
    assert np.array_equal(rvl_counts(encoded(pixels)), pixels)


def test_an_image_of_a_real_size_and_of_the_extremes():
    rng = np.random.default_rng(0)
    pixels = (2000 + 300 * rng.standard_normal((120, 160))).astype(np.uint16)
    pixels[rng.random(pixels.shape) < 0.2] = 0
    pixels[:2] = np.array([[0], [65535]])
    assert np.array_equal(rvl_counts(encoded(pixels)), pixels)


def test_whatever_is_cut_off_is_noticed():
    pixels = np.random.default_rng(1).integers(1, 65536, (6, 9)).astype(np.uint16)
    data = encoded(pixels)
    for length in range(len(data) - 1, -1, -1):
        with pytest.raises(ValueError, match="RVL"):
            rvl_counts(data[:length])


@pytest.mark.parametrize(
    ("size", "words", "message"),
    [
        ((0, 3), [0], "0x3 px"),
        ((-1, -3), [0], "-1x-3 px"),
        ((1 << 20, 1 << 20), [0], "px"),
        ((2, 1), [0x30000000], "more than its 2 pixels"),
        ((2, 1), [0x00000000], "cut short: 0 of 2"),
        ((2, 1), [0xFFFFFFFF, 0xFFFFFFF0], "more than 32 bits"),
        ((2, 1), [0xFFFFFFFF], "cut short"),
    ],
)
def test_what_fits_no_image_is_refused(size, words, message):
    with pytest.raises(ValueError, match=message):
        rvl_counts(struct.pack(f"<ii{len(words)}I", *size, *words))


@given(st.binary(max_size=80))
def test_any_bytes_give_an_image_or_one_kind_of_error(noise):
    try:
        pixels = rvl_counts(struct.pack("<ii", 3, 2) + noise)
    except ValueError:
        return
    assert pixels.shape == (2, 3)
