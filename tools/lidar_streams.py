"""Streams of an RPLIDAR as bytes, made in memory: every answer type, at its usual rate, of a room, with a seed.

Simulated. Unlike the emulator, which answers requests in real time, these exist at once and as long as wanted, also for
the dense capsules that no A2 sends. What a sample's true angle and distance are is what a clean stream decodes to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.messages import FloatArray, LidarStream, RawChunk
from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray, Packets, ultra_offset_q16
from drivers.rplidar_encoding import encode_dense, encode_express, encode_nodes, encode_ultra
from drivers.rplidar_protocol import PACKET_BYTES, PACKET_SAMPLES, Answer
from drivers.rplidar_sample_clock import packet_latency_s

_HZ = 10.0
_DRIFT = 0.03  # the speed wanders by so much, over _DRIFT_S
_DRIFT_S = 2.0
_NOISE_MM = 4.0
_NO_RETURN = 0.03  # share of the samples without a measurement
_Q16_TO_Q3 = 13


@dataclass(frozen=True, slots=True)
class StreamKind:
    """One way to stream: name, answer type, sample time and speed of the line."""

    name: str
    answer: Answer
    sample_us: float
    baud: int

    @property
    def description(self) -> LidarStream:
        """What a decoder needs to know of such a stream."""
        return LidarStream(0, "simulated", "1.28", 0, "", self.baud, self.name, self.answer, self.sample_us, 16.0)


STREAM_KINDS = (
    StreamKind("standard 2 kS/s", Answer.NODES, 500.0, 115200),
    StreamKind("express 4 kS/s", Answer.EXPRESS, 250.0, 115200),
    StreamKind("ultra 8 kS/s", Answer.ULTRA, 125.0, 115200),
    StreamKind("ultra 16 kS/s", Answer.ULTRA, 62.5, 256000),
    StreamKind("dense 9.2 kS/s", Answer.DENSE, 108.7, 256000),
)


def encoded_stream(kind: StreamKind, samples: int, seed: int) -> Packets:
    """At least so many samples as packets (P, size), the first of them the start of a scan."""
    random = np.random.default_rng(seed)
    per_packet = PACKET_SAMPLES[kind.answer]
    packets = -(-samples // per_packet)
    count = packets * per_packet + 1
    head_deg = _head_deg(np.arange(count, dtype=np.float64) * kind.sample_us * 1e-6, random)
    distance_mm = _room_mm(head_deg - 7.0, random)
    head_q6 = np.floor(head_deg * 64).astype(np.int64)
    start_q6 = head_q6[:-1:per_packet] % FULL_TURN_Q6
    restart = np.arange(packets) == 0
    body_mm = distance_mm[:-1].reshape(packets, per_packet)
    if kind.answer == Answer.EXPRESS:
        correction_q3 = ultra_offset_q16(body_mm * 4) >> _Q16_TO_Q3
        return encode_express(start_q6, body_mm, correction_q3, restart)
    if kind.answer == Answer.DENSE:
        return encode_dense(start_q6, body_mm, restart)
    if kind.answer == Answer.ULTRA:
        return encode_ultra(start_q6, distance_mm, restart)
    return _nodes(head_q6[:-1], distance_mm[:-1], random)


def live_chunks(kind: StreamKind, data: bytes, every_s: float) -> list[RawChunk]:
    """The bytes as a host gets them that reads every so often: whole reads, stamped when they would have come."""
    size, per_packet = PACKET_BYTES[kind.answer], PACKET_SAMPLES[kind.answer]
    byte_s = kind.sample_us * 1e-6 * per_packet / size
    latency_s = packet_latency_s(kind.sample_us * 1e-6, size, kind.baud)
    edges = np.append(np.arange(0, len(data), every_s / byte_s).astype(np.int64)[1:], len(data))
    starts = np.concatenate(([0], edges[:-1]))
    return [
        RawChunk(round((end * byte_s + latency_s) * 1e9), data[start:end])
        for start, end in zip(starts.tolist(), edges.tolist(), strict=True)
        if end > start
    ]


def _head_deg(times_s: FloatArray, random: np.random.Generator) -> FloatArray:
    phase = random.uniform(0.0, 2 * np.pi)
    wander = _DRIFT * _DRIFT_S / (2 * np.pi) * np.sin(2 * np.pi * times_s / _DRIFT_S + phase)
    turned: FloatArray = random.uniform(0.0, 360.0) + 360.0 * _HZ * (times_s + wander)
    return turned


def _room_mm(theta_deg: FloatArray, random: np.random.Generator) -> IntArray:
    """Distances in a room of 8 m by 5 m with a pillar, 0 where nothing comes back."""
    theta = np.deg2rad(theta_deg)
    with np.errstate(divide="ignore"):
        across = np.where(np.sin(theta) > 0, 2000.0, -3000.0) / np.sin(theta)
        along = np.where(np.cos(theta) > 0, 5000.0, -3000.0) / np.cos(theta)
    wall = np.minimum(across, along)
    pillar = np.where(np.cos(theta - 1.0) > 0.995, 900.0, np.inf)
    measured = np.rint(np.minimum(wall, pillar) + random.normal(0.0, _NOISE_MM, len(theta)))
    return np.where(random.random(len(theta)) < _NO_RETURN, 0, measured).astype(np.int64)


def _nodes(head_q6: IntArray, distance_mm: IntArray, random: np.random.Generator) -> Packets:
    """Standard nodes: the angle is the ray's, the flag is raised when the head itself begins a turn."""
    angle = (head_q6 - (ultra_offset_q16(distance_mm * 4) >> 10)) % FULL_TURN_Q6
    turn: NDArray[np.bool_] = np.diff(head_q6 // FULL_TURN_Q6, prepend=head_q6[:1] // FULL_TURN_Q6) > 0
    quality = np.where(distance_mm > 0, random.integers(10, 40, len(head_q6)), 0)
    return encode_nodes(angle, distance_mm * 4, quality, turn)
