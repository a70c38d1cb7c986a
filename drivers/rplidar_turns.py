"""Samples to scans: one LaserScan for each turn of the head, in the order in which the samples were taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.messages import FloatArray, LaserScan, LidarStream
from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray, Samples
from drivers.rplidar_sample_clock import SampleClock

Scalar = TypeVar("Scalar", np.int64, np.float64)

_LONG_GAP_S = 0.1
_LONGEST_TURN_S = 1.0  # a head this slow has stalled: do not gather for ever
_SMALLEST_STEP_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Samples of the turn under way; first counts samples, times_s is None until they are fixed."""

    samples: Samples
    first: int
    times_s: FloatArray | None = None


class TurnAssembler:
    """Collects samples, in order, until a turn is over. Times come from the clock, as late as possible."""

    def __init__(self, stream: LidarStream, clock: SampleClock, epoch_ns: int) -> None:
        self._stream = stream
        self._clock = clock
        self._epoch_ns = epoch_ns
        self._pieces: list[_Piece] = []
        self._gathered = 0
        self._whole = False  # did the turn under way begin at a turn's start, and without a gap since?
        self.after_gap = False  # samples were lost before those that come next
        self._newest_time_s = -np.inf

    def add(self, samples: Samples, first: int) -> list[LaserScan]:
        """Take consecutive samples, the first with the running index `first`; return the scans that they complete."""
        scans: list[LaserScan] = []
        start = 0
        for cut in np.flatnonzero(samples.new_turn).tolist():
            scans += self.extend(samples.part(start, cut), first + start)
            scans += self.end_turn()
            start = cut
        return scans + self.extend(samples.part(start, len(samples)) if start else samples, first + start)

    def extend(self, samples: Samples, first: int) -> list[LaserScan]:
        """Take consecutive samples that belong to the turn under way; return one that was over, or takes too long."""
        if not len(samples):
            return []
        scans = self._close() if self.after_gap and self._after_long_gap(first) else []
        self.after_gap = False
        self._pieces.append(_Piece(samples, first))
        self._gathered += len(samples)
        if self._gathered * self._clock.sample_s > _LONGEST_TURN_S:
            self._whole = False
            scans += self._close()
        return scans

    def end_turn(self, *, guessed: bool = False) -> list[LaserScan]:
        """Return the turn under way; where its end is a guess, neither it nor the next one is whole."""
        self._whole = self._whole and not guessed
        scans = self._close()
        self._whole = not guessed
        return scans

    def gap(self) -> None:
        """Samples were lost here: the turn under way is not whole. Who knows the head's angle says if it is over."""
        self._whole = False
        self.after_gap = True

    def fix_times(self) -> None:
        """Settle the times of the samples so far by the clock as it is, before it is restarted."""
        self._pieces = [replace(piece, times_s=self._times_s(piece)) for piece in self._pieces]

    def discard(self) -> None:
        """Drop the turn under way: the device lost track of its angle."""
        self._pieces = []
        self._gathered = 0
        self._whole = False
        self.after_gap = False

    def _after_long_gap(self, first: int) -> bool:
        """Were so many samples lost that the turn is over, wherever the head is now?"""
        if not self._pieces:
            return False
        return bool(self._clock.times_s(first, 1)[0] - self._times_s(self._pieces[-1])[-1] > _LONG_GAP_S)

    def _times_s(self, piece: _Piece) -> FloatArray:
        return self._clock.times_s(piece.first, len(piece.samples)) if piece.times_s is None else piece.times_s

    def _close(self) -> list[LaserScan]:
        """Emit the turn under way, if it has samples."""
        if not self._pieces:
            return []
        pieces, self._pieces, self._gathered = self._pieces, [], 0
        qualities = [piece.samples.quality for piece in pieces if piece.samples.quality is not None]
        angles_rad, ranges_m, offsets_s = _in_si_units(
            _joined([piece.samples.angle_q6 for piece in pieces]),
            _joined([piece.samples.distance_q2 for piece in pieces]),
            self._clock.sample_s,
        )
        first_s = self._clock.time_s(pieces[0].first)
        if first_s > self._newest_time_s and _without_gap(pieces):
            self._newest_time_s = first_s + float(offsets_s[-1])
        else:
            times_s = self._rising(pieces)
            first_s, offsets_s = float(times_s[0]), times_s - times_s[0]
        scan = LaserScan(
            stamp_ns=self._epoch_ns + round(first_s * 1e9),
            angles_rad=angles_rad,
            ranges_m=ranges_m,
            offsets_s=offsets_s,
            range_min_m=self._stream.range_min_m,
            range_max_m=self._stream.range_max_m,
            frame_id=self._stream.frame_id,
            intensities=_joined(qualities).astype(np.float64) if qualities else None,
            complete=self._whole,
        )
        return [scan]

    def _rising(self, pieces: list[_Piece]) -> FloatArray:
        """Strictly rising times: a clock corrected to earlier must not put a sample before one already out."""
        times_s = np.concatenate([self._times_s(piece) for piece in pieces])
        slack = np.arange(1, len(times_s) + 1) * _SMALLEST_STEP_S
        rising: FloatArray = np.maximum(np.maximum.accumulate(times_s - slack), self._newest_time_s) + slack
        self._newest_time_s = float(rising[-1])
        return rising


def _without_gap(pieces: list[_Piece]) -> bool:
    """Do the pieces' samples follow each other, and are all their times still open?"""
    following = pieces[0].first
    for piece in pieces:
        if piece.times_s is not None or piece.first != following:
            return False
        following += len(piece.samples)
    return True


@njit(cache=True, nogil=True)
def _in_si_units(
    angle_q6: IntArray, distance_q2: IntArray, sample_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Angles in rad, clockwise in [0, 360) deg to counter-clockwise in (-pi, pi]; ranges in m; even times in s."""
    half = FULL_TURN_Q6 // 2
    angles_rad, ranges_m, offsets_s = np.empty(len(angle_q6)), np.empty(len(angle_q6)), np.empty(len(angle_q6))
    for sample in range(len(angle_q6)):
        angle = angle_q6[sample]
        angles_rad[sample] = (-angle if angle < half else FULL_TURN_Q6 - angle) * (np.pi / half)
        ranges_m[sample] = distance_q2[sample] / 4000.0
        offsets_s[sample] = sample * sample_s
    return angles_rad, ranges_m, offsets_s


def _joined(arrays: list[NDArray[Scalar]]) -> NDArray[Scalar]:
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
