"""Pixels of depth images as recordings hold them, raw, as PNG, RVL or inverse depth, to uint16 counts.

Depth in metres (float32) becomes counts of METRES_UNIT_M. Everything raises ValueError for bytes that are no image.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from drivers.depth_rvl import rvl_counts

DepthCounts = NDArray[np.uint16]

METRES_UNIT_M = 0.001  # the unit of 16UC1 by REP-118; reaches to 65 m
RAW_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_CONFIG_HEADER = struct.Struct("<iff")  # of compressed_depth_image_transport: format, and two parameters


def raw_counts(encoding: str, size: tuple[int, int], step: int, data: NDArray[np.uint8], *, big: bool) -> DepthCounts:
    """Return the (rows, cols) counts of a sensor_msgs/Image; step: bytes from row to row; big: byte order."""
    if encoding not in RAW_ENCODINGS:
        raise ValueError(f"encoding {encoding!r}, expected {', '.join(RAW_ENCODINGS)}")
    rows, cols = size
    kind = np.dtype(RAW_ENCODINGS[encoding]).newbyteorder(">" if big else "<")
    row_bytes = cols * kind.itemsize
    if min(rows, cols) <= 0 or step < row_bytes or data.size < (rows - 1) * step + row_bytes:
        raise ValueError(f"{data.size} bytes in steps of {step} are no {cols}x{rows} image of {encoding}")
    lines = np.lib.stride_tricks.as_strided(data, (rows, row_bytes), (step, 1), writeable=False)
    pixels = np.ascontiguousarray(lines).view(kind)
    if kind.kind == "f":
        return metres_to_counts(pixels.astype(np.float32))
    return np.asarray(pixels, dtype=np.uint16)


def metres_to_counts(metres: NDArray[np.float32]) -> DepthCounts:
    """Return depth in counts of METRES_UNIT_M; what is not finite, not ahead or too far to count is 0."""
    with np.errstate(invalid="ignore", over="ignore"):
        counts = np.rint(metres.astype(np.float64) / METRES_UNIT_M)
        valid = (counts >= 1) & (counts <= np.iinfo(np.uint16).max)
    return np.where(valid, counts, 0).astype(np.uint16)


def compressed_counts(image_format: str, data: bytes) -> DepthCounts:
    """Return the (rows, cols) counts of a sensor_msgs/CompressedImage of the transport compressedDepth.

    image_format: its format field, as "16UC1; compressedDepth png". The data are a ConfigHeader of 12 bytes and a PNG
    of 16 bits or, where the format says rvl, an RVL image; for 32FC1 its pixels are a / depth + b, a and b from the
    header, 0 where there is no depth. Source: compressed_depth_image_transport of image_transport_plugins.
    """
    encoding, _, transport = image_format.partition(";")
    if "compressedDepth" not in transport:
        raise ValueError(f"format {image_format!r}, expected compressedDepth")
    if len(data) <= _CONFIG_HEADER.size:
        raise ValueError(f"{len(data)} bytes, too few for compressedDepth")
    decode = rvl_counts if "rvl" in transport.lower() else png_counts
    pixels = decode(data[_CONFIG_HEADER.size :])
    if encoding.strip() in {"16UC1", "mono16"}:
        return pixels
    if encoding.strip() != "32FC1":
        raise ValueError(f"format {image_format!r}: its pixels are not 16UC1 or 32FC1")
    _, a, b = _CONFIG_HEADER.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = a / (pixels.astype(np.float64) - b)
    return metres_to_counts(np.where(pixels > 0, metres, 0).astype(np.float32))


def png_counts(data: bytes) -> DepthCounts:
    """Return the (rows, cols) pixels of a grey PNG of 16 bits."""
    import cv2  # noqa: PLC0415 - costs 0.2 s, and only recordings with PNGs need it

    _check_png(data)
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise ValueError("damaged PNG")
    return np.asarray(pixels, dtype=np.uint16)


def _check_png(data: bytes) -> None:
    """Raise ValueError unless this is a whole PNG of one grey channel of 16 bits; libpng itself reports to stderr."""
    if not data.startswith(_PNG_MAGIC):
        raise ValueError(f"no PNG: it starts with {data[:8]!r}" if data else "no PNG: it is empty")
    place, kind = len(_PNG_MAGIC), b""
    while kind != b"IEND":
        head = data[place : place + 8]
        end = place + 12 + int.from_bytes(head[:4], "big")
        if len(head) < 8 or end > len(data):
            raise ValueError("PNG cut short")
        body, kind = data[place + 4 : end - 4], head[4:]
        if zlib.crc32(body) != int.from_bytes(data[end - 4 : end], "big"):
            raise ValueError(f"PNG damaged in its {kind.decode('ascii', 'replace')} chunk")
        if place == len(_PNG_MAGIC) and (kind != b"IHDR" or body[12:14] != b"\x10\x00"):
            raise ValueError("PNG, but not of one grey channel of 16 bits")
        place = end
