"""RVL, the other encoding of compressedDepth: runs of zeros and of differences, as numbers of 3 bits a nibble.

Source: Wilson, "Fast Lossless Depth Image Compression" (ISS 2017), and compressed_depth_image_transport of
image_transport_plugins, which puts columns and rows in front (int32). It has no checksum: a changed byte gives other
depths, and is noticed only where the runs no longer fit the image. Everything raises ValueError for bytes that do not.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_SIZE = struct.Struct("<ii")
_MOST_PIXELS = 1 << 26  # far more than any depth camera has
_MOST_NIBBLES = 11  # of a number of 32 bits
_SHIFTS = np.arange(28, -1, -4, dtype=np.uint32)  # the first nibble of a word is its highest


def rvl_counts(data: bytes) -> NDArray[np.uint16]:
    """Return the (rows, cols) pixels of an RVL image with its size in front."""
    if len(data) < _SIZE.size or len(data) % 4:
        raise ValueError(f"{len(data)} bytes are no RVL image")
    cols, rows = _SIZE.unpack_from(data)
    if cols <= 0 or rows <= 0 or cols * rows > _MOST_PIXELS:
        raise ValueError(f"RVL image of {cols}x{rows} px")
    return _pixels(_numbers(np.frombuffer(data, "<u4", offset=_SIZE.size)), rows * cols).reshape(rows, cols)


def _numbers(words: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Return the numbers in 32-bit words: nibbles of 3 bits, lowest first, whose fourth bit says that more follow."""
    nibbles = ((words[:, np.newaxis] >> _SHIFTS) & 0xF).ravel()
    ends = np.flatnonzero(nibbles < 8)
    if len(ends) == 0:
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    if lengths.max() > _MOST_NIBBLES:
        raise ValueError("RVL image with a number of more than 32 bits")
    used = nibbles[: ends[-1] + 1].astype(np.int64) & 7
    place = np.arange(len(used)) - np.repeat(starts, lengths)
    return np.asarray(np.add.reduceat(used << (3 * place), starts))


def _pixels(numbers: NDArray[np.int64], count: int) -> NDArray[np.uint16]:
    """Return pixels (count,): in turn a run of zeros and one of differences to the last pixel that is not 0."""
    pixels = np.zeros(count, np.uint16)
    is_set = np.zeros(count, np.bool_)
    is_difference = np.zeros(len(numbers), np.bool_)
    number = place = 0
    while place < count:
        zeros, others = numbers[number : number + 2].tolist() if number + 2 <= len(numbers) else (0, 0)
        first, end = place + zeros, place + zeros + others
        if end == place or number + 2 + others > len(numbers):
            raise ValueError(f"RVL image cut short: {place} of {count} pixels")
        if end > count:
            raise ValueError(f"RVL image with more than its {count} pixels")
        is_set[first:end] = True
        is_difference[number + 2 : number + 2 + others] = True
        place, number = end, number + 2 + others
    zigzag = numbers[is_difference]
    pixels[is_set] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1)).astype(np.uint16)
    return pixels
