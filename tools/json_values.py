"""Values of JSON lists that lie beside map files: numbers that may be unknown, paths that move with the folder."""

from __future__ import annotations

import math
import os
from pathlib import Path


def number_or_none(value: object) -> float | None:
    """Return a finite number or None for null; raises ValueError for anything else."""
    if value is None:
        return None
    number = float(value) if isinstance(value, (int, float)) else math.nan
    if not math.isfinite(number):
        raise ValueError(f"{value!r}, expected a number or null")
    return number


def relative_path(path: Path, folder: Path) -> str:
    """Return a path as a list in a folder names it, with slashes on any system."""
    return Path(os.path.relpath(path, folder)).as_posix()
