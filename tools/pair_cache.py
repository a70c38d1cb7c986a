"""Finished registrations in a file, a line a pair, so that a run that was interrupted goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment, Alternative
from mapping.grid import OccupancyGrid
from tools.results import writing_to

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FinishedPair:
    """A registration and how many seconds it took."""

    alignment: Alignment
    seconds: float


class PairCache:
    """The registrations in a file; without a file, in memory only.

    A line that is not whole, the last one of a run that was killed, is left out. Lines are found by the hash of both
    maps and of how they were registered: what has changed is registered anew.
    """

    def __init__(self, path: Path | None, registration: str) -> None:
        self._path = path
        self._registration = registration
        self._pairs: dict[str, FinishedPair] = {}
        self._whole = True
        if path is not None and path.exists():
            with writing_to(path):
                lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
            self._whole = lines[-1] == ""
            for line in lines:
                if (read := _read_line(line)) is not None:
                    self._pairs[read[0]] = read[1]

    def key(self, hash_a: str, hash_b: str) -> str:
        """Return the key of two maps, of which `exact_hash` gives the hashes."""
        return hashlib.sha256(f"{self._registration} {hash_a} {hash_b}".encode()).hexdigest()

    def get(self, key: str) -> FinishedPair | None:
        """Return the pair, if it has been finished."""
        return self._pairs.get(key)

    def add(self, key: str, pair: FinishedPair) -> None:
        """Keep a pair; it is in the file when this returns. Raises ToolError where it cannot be written."""
        self._pairs[key] = pair
        if self._path is None:
            return
        line = json.dumps({"key": key, "seconds": pair.seconds, **alignment_fields(pair.alignment)})
        with writing_to(self._path), self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n" if self._whole else f"\n{line}\n")
            file.flush()
            os.fsync(file.fileno())
        self._whole = True


def exact_hash(grid: OccupancyGrid) -> str:
    """Return a hash of a map's cells, cell size and frame, bit by bit."""
    head = f"{grid.log_odds.shape} {grid.resolution_m!r} "
    return hashlib.sha256(head.encode() + grid.origin.tobytes() + grid.log_odds.tobytes()).hexdigest()


def alignment_fields(alignment: Alignment) -> dict[str, Any]:
    """Return an alignment as a JSON object, with all its digits."""
    return {
        "T_a_b": _listed(alignment.T_a_b),
        "accepted": alignment.accepted,
        "reason": alignment.reason,
        "inliers": alignment.inliers,
        "acceptance": alignment.acceptance,
        "overlap": alignment.overlap,
        "probability": alignment.probability,
        "covariance": _listed(alignment.covariance),
        "alternatives": [[_listed(each.T_a_b), each.probability] for each in alignment.alternatives],
        "scale": alignment.scale,
        "ambiguous": alignment.ambiguous,
        "common_wall_m": alignment.common_wall_m,
        "conflict_m": alignment.conflict_m,
        "slide": alignment.slide,
    }


def _read_line(line: str) -> tuple[str, FinishedPair] | None:
    """Return key and pair of a line; None for one that is not whole."""
    try:
        entry = json.loads(line)
        key, seconds = str(entry.pop("key")), float(entry.pop("seconds"))
        return key, FinishedPair(alignment_of(entry), seconds)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


def alignment_of(entry: Mapping[str, Any]) -> Alignment:
    """Return what `alignment_fields` made an object of; raises ValueError, KeyError or TypeError for another one."""
    fields = dict(entry)
    fields["T_a_b"], fields["covariance"] = _array(fields["T_a_b"]), _array(fields["covariance"])
    fields["alternatives"] = tuple(Alternative(np.array(pose), share) for pose, share in fields["alternatives"])
    slide = fields["slide"]
    fields["slide"] = None if slide is None else (float(slide[0]), float(slide[1]))
    return Alignment(**fields)


def _listed(array: FloatArray | None) -> list[Any] | None:
    return None if array is None else list(array.tolist())


def _array(values: list[Any] | None) -> FloatArray | None:
    return None if values is None else np.array(values, dtype=np.float64)
