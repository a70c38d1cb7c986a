"""All scans of a drive: when each was taken, where relative to its keyframe, and its points while memory lasts."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]
StampArray = NDArray[np.int64]
IndexArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class ArchivedScan:
    """A scan at T_keyframe_scan (3,), its pose in keyframe number `keyframe`.

    points (N, 2) are in the body frame, None once they had to go; matched: it may be drawn and refined; known: a match
    or the wheels say where it is.
    """

    stamp_ns: int
    keyframe: int
    T_keyframe_scan: FloatArray
    points: FloatArray | None
    matched: bool
    known: bool
    is_keyframe: bool


class ScanArchive:
    """Keeps every scan's pose, and points up to a number of bytes: then every second scan's go, except keyframes'.

    Later scans are thinned as those before, or the beginning of a long drive would be drawn from fewer than its end.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        self._loose_bytes = 0  # in scans that are no keyframes
        self._loose = 0
        self._every = 1  # of the scans that are no keyframes, one in so many keeps its points
        self._stamps: list[int] = []
        self._keyframes: list[int] = []
        self._relative: list[FloatArray] = []
        self._points: list[NDArray[np.float32] | None] = []
        self._matched: list[bool] = []
        self._known: list[bool] = []
        self._is_keyframe: list[bool] = []

    def __len__(self) -> int:
        return len(self._stamps)

    def __getitem__(self, number: int) -> ArchivedScan:
        points = self._points[number]
        return ArchivedScan(
            self._stamps[number], self._keyframes[number], self._relative[number],
            None if points is None else points.astype(np.float64), self._matched[number], self._known[number],
            self._is_keyframe[number],
        )  # fmt: skip

    def add(
        self, stamp_ns: int, keyframe: int, T_keyframe_scan: FloatArray, points: FloatArray, *, matched: bool,
        known: bool,
        is_keyframe: bool,
    ) -> None:  # fmt: skip
        """Take in a scan; points (N, 2) are kept with single precision."""
        self._loose += not is_keyframe
        is_kept = is_keyframe or self._loose % self._every == 0
        kept = points.astype(np.float32) if is_kept else None
        self._stamps.append(stamp_ns)
        self._keyframes.append(keyframe)
        self._relative.append(np.array(T_keyframe_scan, dtype=np.float64))
        self._points.append(kept)
        self._matched.append(matched)
        self._known.append(known)
        self._is_keyframe.append(is_keyframe)
        if kept is not None:
            self._bytes += kept.nbytes
            self._loose_bytes += 0 if is_keyframe else kept.nbytes
        while self._bytes > self._most_bytes and self._loose_bytes:
            self._thin()

    def remove_last(self, count: int) -> None:
        """Forget the last scans: their stamps were wrong."""
        first = max(0, len(self) - count)
        for points, is_keyframe in zip(self._points[first:], self._is_keyframe[first:], strict=True):
            if points is not None:
                self._bytes -= points.nbytes
                self._loose_bytes -= 0 if is_keyframe else points.nbytes
            self._loose -= not is_keyframe
        for column in (
            self._stamps, self._keyframes, self._relative, self._points, self._matched, self._known, self._is_keyframe
        ):  # fmt: skip
            del column[first:]

    def copy(self) -> ScanArchive:
        """Return an archive with the same scans, of which the one does not see the other's changes."""
        other = copy(self)
        other._stamps, other._keyframes, other._relative = [*self._stamps], [*self._keyframes], [*self._relative]
        other._points, other._matched, other._known = [*self._points], [*self._matched], [*self._known]
        other._is_keyframe = [*self._is_keyframe]
        return other

    def move(self, number: int, T_keyframe_scan: FloatArray) -> None:
        """Put a scan elsewhere relative to its keyframe."""
        self._relative[number] = T_keyframe_scan

    def table(self) -> tuple[StampArray, IndexArray, FloatArray]:
        """Return stamps (N,), keyframes (N,) and poses in them (N, 3) of all scans."""
        stamps, keyframes = np.array(self._stamps, dtype=np.int64), np.array(self._keyframes, dtype=np.int64)
        return stamps, keyframes, np.array(self._relative).reshape(-1, 3)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return all of it as arrays; `counts` is -1 where a scan's points had to go."""
        kept = [points for points in self._points if points is not None]
        counts = [-1 if points is None else len(points) for points in self._points]
        stamps, keyframes, relative = self.table()
        return {
            "stamps_ns": stamps,
            "keyframes": keyframes,
            "relative": relative,
            "counts": np.array(counts, dtype=np.int64),
            "points": np.concatenate(kept) if kept else np.zeros((0, 2), np.float32),
            "matched": np.array(self._matched, dtype=np.bool_),
            "known": self.known(),
            "is_keyframe": np.array(self._is_keyframe, dtype=np.bool_),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` of an earlier archive returned."""
        first = 0
        for number, count in enumerate(arrays["counts"].tolist()):
            points = arrays["points"][first : first + max(count, 0)]
            first += max(count, 0)
            self.add(
                int(arrays["stamps_ns"][number]),
                int(arrays["keyframes"][number]),
                arrays["relative"][number],
                points,
                matched=bool(arrays["matched"][number]),
                known=bool(arrays["known"][number]),
                is_keyframe=bool(arrays["is_keyframe"][number]),
            )
            if count < 0:
                self._points[-1] = None

    def known(self) -> NDArray[np.bool_]:
        """Return for each scan (N,) whether a match or the wheels gave its pose; else it is a guess."""
        return np.array(self._known, dtype=np.bool_)

    def _thin(self) -> None:
        """Let go of every second scan's points that are left, so that the rest covers the whole drive evenly."""
        self._every *= 2
        rank = 0
        for number, points in enumerate(self._points):
            if self._is_keyframe[number]:
                continue
            rank += 1
            if points is not None and rank % self._every:
                self._points[number] = None
                self._bytes -= points.nbytes
                self._loose_bytes -= points.nbytes


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScans:
    """The scans of a drive in the map: keyframe poses (K, 3), and in_map (K,) whether a keyframe's place is known."""

    archive: ScanArchive
    poses: FloatArray
    in_map: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.archive)

    def get(self, number: int) -> tuple[FloatArray, FloatArray] | None:
        """Return pose (3,) in the map and points (N, 2) in the body frame of a scan; None where it is not drawn."""
        scan = self.archive[number]
        if scan.points is None or not scan.matched or not self.in_map[scan.keyframe]:
            return None
        return se2.compose(self.poses[scan.keyframe], scan.T_keyframe_scan), scan.points

    def copy(self) -> PlacedScans:
        """Return the same, of which later changes are not seen."""
        return PlacedScans(self.archive.copy(), self.poses.copy(), self.in_map.copy())
