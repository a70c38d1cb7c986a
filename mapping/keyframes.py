"""Keyframes: the scans that the map is made of, in flat arrays that compiled code walks through.

Arrays only grow: what a snapshot shows never changes, so another thread may work on it while the store goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapping.surface import Surface

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]
_Scalar = TypeVar("_Scalar", bound=np.generic)

_FIRST_CAPACITY = 65536


@dataclass(frozen=True, slots=True, eq=False)
class Clouds:
    """The surfaces of K keyframes, one behind the other: keyframe k has the samples starts[k] to starts[k + 1].

    points, normals (M, 2), angles, ranges, levels, reaches (M,), see Surface, in each keyframe's own body frame;
    starts (K + 1,); sensor (2,) is the laser's place on the body.
    """

    points: Float32Array
    angles: Float32Array
    ranges: Float32Array
    normals: Float32Array
    levels: Float32Array
    reaches: Float32Array
    starts: IndexArray
    sensor: FloatArray

    def __len__(self) -> int:
        return len(self.starts) - 1

    def points_of(self, keyframe: int) -> FloatArray:
        """Return the points (N, 2) of a keyframe in its body frame."""
        return self.points[self.starts[keyframe] : self.starts[keyframe + 1]].astype(np.float64)

    def normals_of(self, keyframe: int) -> FloatArray:
        """Return the normals (N, 2) of a keyframe's samples, (0, 0) where there is no straight wall."""
        return self.normals[self.starts[keyframe] : self.starts[keyframe + 1]].astype(np.float64)


class KeyframeStore:
    """Collects the surfaces of keyframes; sensor (2,) is the laser's place on the body."""

    def __init__(self, sensor: FloatArray) -> None:
        self.sensor = np.array(sensor, dtype=np.float64)
        self._samples = 0
        self._columns = {
            name: np.empty((_FIRST_CAPACITY, *shape), dtype=np.float32)
            for name, shape in (
                ("points", (2,)), ("angles", ()), ("ranges", ()), ("normals", (2,)), ("levels", ()), ("reaches", ()),
            )
        }  # fmt: skip
        self._starts = np.zeros(1025, dtype=np.int64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, surface: Surface) -> int:
        """Take in one keyframe and return its number."""
        first, last = self._samples, self._samples + len(surface.points)
        for name in self._columns:
            if last > len(self._columns[name]):
                self._columns[name] = _doubled(self._columns[name], last)
            self._columns[name][first:last] = getattr(surface, name)
        if self._count + 2 > len(self._starts):
            self._starts = _doubled(self._starts, self._count + 2)
        self._count += 1
        self._starts[self._count] = self._samples = last
        return self._count - 1

    def restore(self, clouds: Clouds) -> None:
        """Begin with the keyframes of an earlier drive; the store must be empty."""
        assert not self._count
        self._samples, self._count = int(clouds.starts[-1]), len(clouds)
        for name, empty in self._columns.items():
            self._columns[name] = _doubled(empty[:0], max(self._samples, _FIRST_CAPACITY))
            self._columns[name][: self._samples] = getattr(clouds, name)
        self._starts = _doubled(self._starts[:0], self._count + 1025)
        self._starts[: self._count + 1] = clouds.starts

    def remove_last(self) -> None:
        """Forget the keyframe that came last; no snapshot of it may be in use any more."""
        self._count -= 1
        self._samples = int(self._starts[self._count])

    def snapshot(self) -> Clouds:
        """Return all keyframes so far; later ones do not change it."""
        columns = {name: column[: self._samples] for name, column in self._columns.items()}
        return Clouds(**columns, starts=self._starts[: self._count + 1], sensor=self.sensor)


def _doubled(array: NDArray[_Scalar], least: int) -> NDArray[_Scalar]:
    """Return a longer copy of an array."""
    longer = np.empty((max(2 * len(array), least), *array.shape[1:]), dtype=array.dtype)
    longer[: len(array)] = array
    return longer
