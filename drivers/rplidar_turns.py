"""Samples to scans: one LaserScan for each turn of the head, in the order in which the samples were taken."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.messages import FloatArray, LaserScan, LidarStream
from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray, Samples
from drivers.rplidar_sample_clock import SampleClock

_BACKWARDS_Q6 = 20 * 64  # a corrected angle falls by up to 8 deg within a turn
_LONG_GAP_S = 0.1
_LONGEST_TURN_S = 1.0  # a head this slow has stalled: do not gather for ever
_SMALLEST_STEP_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Samples of the turn under way; index counts samples, times_s is None until they are fixed."""

    samples: Samples
    index: IntArray
    times_s: FloatArray | None = None


class TurnAssembler:
    """Collects samples, in order, until a turn is over. Times come from the clock, as late as possible."""

    def __init__(self, stream: LidarStream, clock: SampleClock, epoch_ns: int) -> None:
        self._stream = stream
        self._clock = clock
        self._epoch_ns = epoch_ns
        self._pieces: list[_Piece] = []
        self._whole = False  # did the turn under way begin at a turn's start, and without a gap since?
        self.after_gap = False  # samples were lost before those that come next
        self._newest_time_s = -np.inf

    def add(self, samples: Samples, index: IntArray) -> list[LaserScan]:
        """Take consecutive samples with their running index (N,); return the scans that they complete."""
        scans: list[LaserScan] = []
        if self.after_gap and self._turn_ended_in_gap(samples, index):
            scans += self._close()
            self._whole = False
        self.after_gap = False
        cuts = np.flatnonzero(samples.new_turn)
        start = 0
        for cut in (*cuts.tolist(), len(samples)):
            if cut > start:
                self._pieces.append(_part(samples, index, start, cut))
            if cut < len(samples):
                scans += self._close()
                self._whole = True
            start = cut
        if self._gathered() * self._clock.sample_s > _LONGEST_TURN_S:
            self._whole = False
            scans += self._close()
        return scans

    def gap(self) -> None:
        """Samples were lost here: the turn under way is not whole."""
        self._whole = False
        self.after_gap = True

    def fix_times(self) -> None:
        """Settle the times of the samples so far by the clock as it is, before it is restarted."""
        self._pieces = [replace(piece, times_s=self._times_s(piece)) for piece in self._pieces]

    def discard(self) -> None:
        """Drop the turn under way: the device lost track of its angle."""
        self._pieces = []
        self._whole = False
        self.after_gap = False

    def _gathered(self) -> int:
        return sum(len(piece.index) for piece in self._pieces)

    def _turn_ended_in_gap(self, samples: Samples, index: IntArray) -> bool:
        if not self._pieces or samples.new_turn[0]:
            return False
        last = self._pieces[-1]
        if self._clock.times_s(index[:1])[0] - self._times_s(last)[-1] > _LONG_GAP_S:
            return True
        return bool(samples.angle_q6[0] < last.samples.angle_q6[-1] - _BACKWARDS_Q6)

    def _times_s(self, piece: _Piece) -> FloatArray:
        return self._clock.times_s(piece.index) if piece.times_s is None else piece.times_s

    def _close(self) -> list[LaserScan]:
        """Emit the turn under way, if it has samples."""
        if not self._pieces:
            return []
        parts, self._pieces = self._pieces, []
        times_s = self._rising(np.concatenate([self._times_s(part) for part in parts]))
        distance_q2 = np.concatenate([part.samples.distance_q2 for part in parts])
        qualities = [part.samples.quality for part in parts if part.samples.quality is not None]
        scan = LaserScan(
            stamp_ns=self._epoch_ns + round(times_s[0] * 1e9),
            angles_rad=_counter_clockwise_rad(np.concatenate([part.samples.angle_q6 for part in parts])),
            ranges_m=distance_q2 / 4000.0,
            offsets_s=times_s - times_s[0],
            range_min_m=self._stream.range_min_m,
            range_max_m=self._stream.range_max_m,
            frame_id=self._stream.frame_id,
            intensities=np.concatenate(qualities).astype(np.float64) if qualities else None,
            complete=self._whole,
        )
        return [scan]

    def _rising(self, times_s: FloatArray) -> FloatArray:
        """Times made strictly rising: a clock corrected to earlier must not put a sample before one already out."""
        slack = np.arange(1, len(times_s) + 1) * _SMALLEST_STEP_S
        rising: FloatArray = np.maximum(np.maximum.accumulate(times_s - slack), self._newest_time_s) + slack
        self._newest_time_s = float(rising[-1])
        return rising


def _part(samples: Samples, index: IntArray, start: int, stop: int) -> _Piece:
    part = slice(start, stop)
    quality = None if samples.quality is None else samples.quality[part]
    return _Piece(
        Samples(samples.angle_q6[part], samples.distance_q2[part], samples.new_turn[part], quality), index[part]
    )


def _counter_clockwise_rad(angle_q6: IntArray) -> FloatArray:
    """Clockwise angles in [0, 360) deg to counter-clockwise ones in (-pi, pi]."""
    half = FULL_TURN_Q6 // 2
    turned = np.where(angle_q6 < half, -angle_q6, FULL_TURN_Q6 - angle_q6)
    return turned * np.pi / half
