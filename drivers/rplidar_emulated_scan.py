"""The measuring half of the RPLIDAR emulator: a turning head, rays into a world, packets when their time has come."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.messages import FloatArray
from drivers.rplidar_capsules import (
    FULL_TURN_Q6,
    Q6_TO_Q16,
    IntArray,
    Packets,
    head_angles_q16,
    ultra_offset_q16,
)
from drivers.rplidar_encoding import encode_express, encode_nodes, encode_ultra
from drivers.rplidar_protocol import DEFAULT_PWM, PACKET_BYTES, PACKET_SAMPLES, Answer, ScanMode
from drivers.rplidar_sample_clock import packet_latency_s

Ranger = Callable[[IntArray, FloatArray], FloatArray]
"""(Sample times in monotonic ns, clockwise angles in rad from the sensor's zero) to ranges in m, 0 = none; all (N,)."""

_BLIND_MM = 150
_MAX_EXPRESS_MM = 16383
_GOOD_QUALITY = 15
_GUESS_Q2 = np.array([2000 * 4])  # to find the first ray's angle, before its distance is known
_REFINEMENTS = 4
_CONSISTENT_Q16 = 1 << 13  # 1/8 deg


class Motor:
    """Head angle over time; the speed follows the PWM duty at once, the angle never jumps.

    drift: share by which the speed swings around that, and the period in s.
    """

    def __init__(self, pwm: int, default_hz: float, drift: tuple[float, float] = (0.0, 1.0)) -> None:
        self._default_hz = default_hz
        self._drift = drift
        self._starts_s = [0.0]
        self._turns = [0.0]
        self._rates_hz = [self._rate(pwm)]

    @property
    def running(self) -> bool:
        """Is it turning now?"""
        return self._rates_hz[-1] > 0

    def set_pwm(self, pwm: int, now_ns: int) -> None:
        """Change the duty, 0 stops."""
        turns = float(self.turns(np.array([now_ns * 1e-9]))[0])
        self._starts_s, self._turns, self._rates_hz = (
            [*history[-1:], value]
            for history, value in (
                (self._starts_s, now_ns * 1e-9),
                (self._turns, turns),
                (self._rates_hz, self._rate(pwm)),
            )
        )

    def turns(self, times_s: FloatArray) -> FloatArray:
        """Turns made by times_s (N,), growing."""
        part = np.maximum(np.searchsorted(self._starts_s, times_s, side="right") - 1, 0)
        starts_s, turns, rates_hz = (np.array(history) for history in (self._starts_s, self._turns, self._rates_hz))
        since_s = (
            self._driven_s(times_s) - self._driven_s(starts_s[part]) if self._drift[0] else times_s - starts_s[part]
        )
        return np.asarray(turns[part] + rates_hz[part] * since_s, dtype=np.float64)

    def _driven_s(self, times_s: FloatArray) -> FloatArray:
        """How long a steady motor would need for the same turns: the integral of the relative speed."""
        share, period_s = self._drift
        circle = 2.0 * np.pi / period_s
        return np.asarray(times_s - share / circle * np.cos(circle * times_s), dtype=np.float64)

    def _rate(self, pwm: int) -> float:
        return self._default_hz * pwm / DEFAULT_PWM


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """Where and when the samples of some packets were taken: head angle (N,) in 1/65536 deg, time (N,) in ns."""

    head_q16: IntArray
    times_ns: IntArray


class EmulatedScan:
    """One running scan. A packet is due when its last bit has left a UART of this speed, as on the sensor."""

    def __init__(self, mode: ScanMode, baud: int, motor: Motor, ranger: Ranger, start_ns: int) -> None:
        self._kind = Answer(mode.answer_type)
        self._count = PACKET_SAMPLES[self._kind]
        self._sample_s = mode.sample_us * 1e-6
        self._latency_s = packet_latency_s(self._sample_s, PACKET_BYTES[self._kind], baud)
        self._max_mm = math.floor(mode.max_distance_m * 1000)
        self._motor = motor
        self._ranger = ranger
        self._start_ns = start_ns
        self._done = 0  # packets
        self._next_mm: int | None = None  # the first distance of the next ultra capsule, measured with the last one

    def due(self, now_ns: int) -> Packets:
        """(P, size) the packets that have become due since the last call."""
        since_s = (now_ns - self._start_ns) * 1e-9 - self._latency_s
        ready = math.floor((since_s / self._sample_s + 1) / self._count)
        first, self._done = self._done, max(self._done, ready)
        if self._done == first:
            return np.empty((0, PACKET_BYTES[self._kind]), dtype=np.uint8)
        encode = {Answer.NODES: self._nodes, Answer.EXPRESS: self._express, Answer.ULTRA: self._ultra}[self._kind]
        return encode(first, self._done - first)

    def _start_angles_q6(self, first: int, count: int) -> IntArray:
        """Start angles of count packets and of the one behind them."""
        samples = (first + np.arange(count + 1)) * self._count
        turns = self._motor.turns(np.asarray(self._start_ns * 1e-9 + samples * self._sample_s, dtype=np.float64))
        return np.floor(turns % 1.0 * FULL_TURN_Q6).astype(np.int64)

    def _rays(self, first: int, start_q6: IntArray) -> _Rays:
        """Rays of the packets and of the first sample behind them, at the angles that a decoder will interpolate."""
        head = head_angles_q16(start_q6, self._count, self._kind).reshape(-1)
        index = first * self._count + np.arange(len(head) + 1)
        times_ns = self._start_ns + np.round(index * self._sample_s * 1e9).astype(np.int64)
        return _Rays(np.append(head, start_q6[-1] << Q6_TO_Q16), times_ns)

    def _measure_mm(self, times_ns: IntArray, angle_q6: IntArray) -> IntArray:
        theta_rad = np.asarray(angle_q6 % FULL_TURN_Q6 * (2 * np.pi / FULL_TURN_Q6), dtype=np.float64)
        ranges_m = self._ranger(times_ns, theta_rad)
        finite = np.where(np.isfinite(ranges_m), ranges_m, 0.0)
        distance = np.rint(np.clip(finite, 0.0, 1000.0) * 1000).astype(np.int64)
        return np.where((distance >= _BLIND_MM) & (distance <= self._max_mm), distance, 0)

    def _offsets_q16(self, rays: _Rays) -> IntArray:
        """Angle between head and ray, from what the ray would meet at a middling distance."""
        guess = ultra_offset_q16(_GUESS_Q2)
        met_mm = self._measure_mm(rays.times_ns, (rays.head_q16 - guess) >> Q6_TO_Q16)
        return ultra_offset_q16(met_mm * 4)

    def _nodes(self, first: int, count: int) -> Packets:
        start_q6 = self._start_angles_q6(first - 1, count)  # one before: where did the turn counter change?
        rays = self._rays(first - 1, start_q6)
        head, times_ns = rays.head_q16[1:], rays.times_ns[1:]
        angle = ((head - self._offsets_q16(_Rays(head, times_ns))) >> Q6_TO_Q16) % FULL_TURN_Q6
        distance_q2 = self._measure_mm(times_ns, angle) * 4
        quality = np.where(distance_q2 > 0, _GOOD_QUALITY, 0)
        return encode_nodes(angle, distance_q2, quality, np.diff(rays.head_q16) < 0)

    def _express(self, first: int, count: int) -> Packets:
        start_q6 = self._start_angles_q6(first, count)
        rays = self._rays(first, start_q6)
        rays = _Rays(rays.head_q16[:-1], rays.times_ns[:-1])
        correction_q3 = np.clip((self._offsets_q16(rays) + (1 << 12)) >> 13, 0, 63)
        distance = self._measure_mm(rays.times_ns, (rays.head_q16 - (correction_q3 << 13)) >> Q6_TO_Q16)
        distance = np.where(distance <= _MAX_EXPRESS_MM, distance, 0)
        shape = (count, self._count)
        return encode_express(
            start_q6[:-1], distance.reshape(shape), correction_q3.reshape(shape), _opening(first, count)
        )

    def _ultra(self, first: int, count: int) -> Packets:
        """The decoder derives the ray's angle from the distance: search the ray that is where its distance puts it."""
        start_q6 = self._start_angles_q6(first, count)
        rays = self._rays(first, start_q6)
        offset = self._offsets_q16(rays)
        distance = np.zeros_like(offset)
        open_rays = np.arange(len(offset))
        for _ in range(_REFINEMENTS):
            angle = (rays.head_q16[open_rays] - offset[open_rays]) >> Q6_TO_Q16
            met_mm = self._measure_mm(rays.times_ns[open_rays], angle)
            needed = ultra_offset_q16(met_mm * 4)
            settled = np.abs(needed - offset[open_rays]) <= _CONSISTENT_Q16
            distance[open_rays[settled]] = met_mm[settled]
            offset[open_rays] = needed
            open_rays = open_rays[~settled]
            if not len(open_rays):
                break
        # What stays open straddles an edge: no measurement.
        if self._next_mm is not None:
            distance[0] = self._next_mm
        self._next_mm = int(distance[-1])
        return encode_ultra(start_q6[:-1], distance, _opening(first, count))


def _opening(first: int, count: int) -> NDArray[np.bool_]:
    """(P,) the restart flag: set in the very first capsule of a scan only."""
    return np.array([packet == 0 for packet in range(first, first + count)])
