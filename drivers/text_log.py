"""Line-based logs as they lie on disks: plain, gzip or bzip2, told by their first bytes, and whole or cut off."""

from __future__ import annotations

import bz2
import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path

_DAMAGE = (EOFError, OSError, zlib.error, gzip.BadGzipFile)
_HEAD_BYTES = 65536


class TextLog:
    """The lines of one file; damage says why they ended before the file should, "" as long as they did not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage = ""

    def lines(self) -> Iterator[bytes]:
        """Yield the lines with their ends, up to the end of the file or of what can be uncompressed."""
        with _open(self.path) as stream:
            try:
                yield from stream
            except _DAMAGE as error:
                self.damage = f"cut or damaged: {str(error).lower()}"


def first_lines(path: Path) -> list[bytes]:
    """Return the lines at the beginning of a text file, the last of them perhaps cut; [] where it is none."""
    try:
        with _open(path) as stream:
            head = stream.read(_HEAD_BYTES)
    except _DAMAGE:
        return []
    return [] if b"\0" in head else head.splitlines()


def _open(path: Path) -> io.BufferedIOBase:
    """Open a log whatever it is compressed with."""
    with path.open("rb") as stream:
        head = stream.read(3)
    if head == b"BZh":
        return bz2.open(path, "rb")
    if head[:2] == b"\x1f\x8b":
        return gzip.open(path, "rb")
    return path.open("rb")
