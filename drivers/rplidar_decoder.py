"""Raw chunks of an RPLIDAR's port to laser scans: a pure function of the stream's description and the chunks.

No clock is asked, so a recorded stream decodes to the scans that it gave live, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFaultError
from drivers.messages import FloatArray, LaserScan, LidarStream, RawChunk
from drivers.rplidar_capsules import DECODERS, FULL_TURN_Q6, IntArray, Packets, Samples, restart_flags, start_angles_q6
from drivers.rplidar_framing import PacketRun, find_packets
from drivers.rplidar_protocol import (
    DESCRIPTOR_BYTES,
    PACKET_BYTES,
    PACKET_SAMPLES,
    Answer,
    Descriptor,
)
from drivers.rplidar_sample_clock import SampleClock, packet_latency_s
from drivers.rplidar_turns import TurnAssembler
from drivers.uart import BITS_PER_BYTE

_FASTEST_TURN_HZ = 30.0  # twice what the head can do: a larger step between capsules is damage
_SPEED_UP = 1.5  # between neighbouring capsules inertia forbids more: whole capsules were lost
_SPEED_UP_SLACK_Q6 = 2 * 64
_LONGEST_WAIT_S = 0.25  # capsules wait so long for the end of their turn


@dataclass(frozen=True, slots=True)
class DecoderCounters:
    """What a decoder has seen: rejected_packets = places where packets were damaged or missing."""

    samples: int = 0
    valid_samples: int = 0
    packets: int = 0
    rejected_packets: int = 0
    resync_bytes: int = 0
    scans: int = 0
    partial_scans: int = 0


class RplidarDecoder:
    """Decodes one stream; bytes may be cut anywhere. A stream that is started anew needs a new decoder."""

    def __init__(self, stream: LidarStream) -> None:
        if stream.answer_type not in DECODERS:
            known = ", ".join(f"0x{kind:02X}" for kind in DECODERS)
            raise DeviceFaultError(
                f"{stream.model} mode {stream.mode}: unknown answer type 0x{stream.answer_type:02X}, expected {known}:"
                " choose another scan mode"
            )
        self._kind = Answer(stream.answer_type)
        self._sample_s = stream.sample_us * 1e-6
        self._byte_s = BITS_PER_BYTE / stream.baud
        self._latency_s = packet_latency_s(self._sample_s, PACKET_BYTES[self._kind], stream.baud)
        self._clock = SampleClock(self._sample_s)
        self._stream = stream
        self._turns: TurnAssembler | None = None
        self._epoch_ns = 0
        self._pending = b""  # bytes not settled yet
        self._maybe_descriptor = True
        self._locked = True  # a stream begins with a packet
        self._skipped = 0  # bytes between the last sound packet and the pending ones
        self._held = np.empty((0, PACKET_BYTES[self._kind]), dtype=np.uint8)  # capsules that wait for their turn's end
        self._step_q6: int | None = None  # the last sound step of the head from capsule to capsule
        self._next_packet = 0
        self._counts = dict.fromkeys(DecoderCounters.__slots__, 0)

    @property
    def counters(self) -> DecoderCounters:
        """A snapshot of the counters."""
        counts = dict(self._counts)
        if len(self._held) > 1:
            self._count(counts, DECODERS[self._kind](self._held))
        return DecoderCounters(**counts)

    def feed(self, chunk: RawChunk) -> list[LaserScan]:
        """Take the next chunk; return the turns that are over, oldest first, the first partial one included."""
        if self._turns is None:
            self._epoch_ns = chunk.stamp_ns
            self._turns = TurnAssembler(self._stream, self._clock, chunk.stamp_ns)
        self._pending += chunk.data
        if self._maybe_descriptor and not self._strip_descriptor():
            return []
        framing = find_packets(self._pending, self._kind, self._locked)
        self._locked = framing.locked
        scans: list[LaserScan] = []
        settled = 0
        chunk_s = (chunk.stamp_ns - self._epoch_ns) * 1e-9
        for run in framing.runs:
            self._skip(run.start - settled)
            scans += self._take(run, chunk_s, self._turns)
            settled = run.end
        self._skip(framing.used - settled)
        self._pending = self._pending[framing.used :]
        self._counts["scans"] += len(scans)
        self._counts["partial_scans"] += sum(not scan.complete for scan in scans)
        return scans

    def _strip_descriptor(self) -> bool:
        """Drop the stream's own descriptor if the bytes begin with it; False while that cannot be told yet."""
        whole = Descriptor(PACKET_BYTES[self._kind], repeats=True, kind=self._kind).encode()
        begin = self._pending[:DESCRIPTOR_BYTES]
        if len(begin) < DESCRIPTOR_BYTES and whole.startswith(begin):
            return False
        if begin == whole:
            self._pending = self._pending[DESCRIPTOR_BYTES:]
        self._maybe_descriptor = False
        return True

    def _skip(self, count: int) -> None:
        self._skipped += count
        self._counts["resync_bytes"] += count

    def _take(self, run: PacketRun, chunk_s: float, turns: TurnAssembler) -> list[LaserScan]:
        """Decode a run of sound packets that ended `behind` bytes before the chunk did."""
        scans = self._bridge_damage(turns) if self._skipped else []
        count = len(run.packets)
        first = self._next_packet
        self._next_packet += count
        self._counts["packets"] += count
        size = PACKET_BYTES[self._kind]
        behind = len(self._pending) - (run.start + size * np.arange(1, count + 1))
        last_sample = (first + np.arange(1, count + 1)) * PACKET_SAMPLES[self._kind] - 1
        not_after_s = np.asarray(chunk_s - behind * self._byte_s - self._latency_s, dtype=np.float64)
        if self._kind == Answer.NODES:
            self._clock.observe(last_sample, not_after_s)
            return scans + self._decode(run.packets, first, turns)
        return scans + self._take_capsules(run.packets, first, last_sample, not_after_s, turns)

    def _bridge_damage(self, turns: TurnAssembler) -> list[LaserScan]:
        """Carry on after skipped bytes; the sample count stays known where whole packets were damaged, not lost.

        Returns what the capsules that waited complete: a turn that took too long.
        """
        lost, rest = divmod(self._skipped, PACKET_BYTES[self._kind])
        self._skipped = 0
        if self._next_packet == 0:
            return []
        scans = self._decode(self._held, self._next_packet - len(self._held), turns)
        self._counts["rejected_packets"] += max(1, lost)
        self._next_packet += lost
        self._break(turns, restart_clock=rest != 0)
        return scans

    def _break(self, turns: TurnAssembler, *, restart_clock: bool) -> None:
        turns.gap()
        self._held = self._held[:0]
        if restart_clock:
            turns.fix_times()
            self._clock.restart()

    def _take_capsules(
        self,
        packets: Packets,
        first: int,
        last_sample: IntArray,
        not_after_s: FloatArray,
        turns: TurnAssembler,
    ) -> list[LaserScan]:
        """Settle capsules up to the last, whose samples depend on the next; decode them once a turn is over.

        Decoding is numpy on short arrays: a turn at once costs a fraction of what its pieces would.
        """
        held = len(self._held)
        stack = np.concatenate((self._held, packets))
        first -= held
        settled = max(held - 1, 0)  # steps known from before
        turned = np.diff(start_angles_q6(stack[settled:]))
        steps, restarts = turned % FULL_TURN_Q6, restart_flags(stack[settled + 1 :])
        broken = self._broken_steps(steps, restarts)
        cuts = np.flatnonzero(restarts | broken)
        waited_s = len(stack) * PACKET_SAMPLES[self._kind] * self._sample_s
        if not (len(cuts) or (turned < 0).any() or turns.after_gap or waited_s > _LONGEST_WAIT_S):
            self._clock.observe(last_sample, not_after_s)
            self._held = stack
            return []
        scans: list[LaserScan] = []
        start = observed = 0
        for cut in (*(cuts + settled).tolist(), len(stack) - 1):
            known = cut + 1 - held  # packets of this run up to the cut
            if known > observed:
                self._clock.observe(last_sample[observed:known], not_after_s[observed:known])
                observed = known
            scans += self._decode(stack[start : cut + 1], first + start, turns)
            start = cut + 1
            if cut == len(stack) - 1:
                break
            self._counts["rejected_packets"] += int(broken[cut - settled])
            self._break(turns, restart_clock=True)
            if restarts[cut - settled]:
                turns.discard()
        self._held = stack[-1:].copy()
        return scans

    def _broken_steps(self, steps_q6: IntArray, restarts: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """For each step between neighbouring capsules: is it one that the head cannot have made?"""
        limit_q6 = PACKET_SAMPLES[self._kind] * self._sample_s * _FASTEST_TURN_HZ * FULL_TURN_Q6
        broken = np.zeros(len(steps_q6), dtype=np.bool_)
        for place, (step, restart) in enumerate(zip(steps_q6.tolist(), restarts.tolist(), strict=True)):
            if restart:
                continue
            before = step if self._step_q6 is None else self._step_q6
            fits = step <= _inertia_limit_q6(before) and before <= _inertia_limit_q6(step) and step <= limit_q6
            broken[place] = not fits
            self._step_q6 = step if fits else None
        return broken

    def _decode(self, packets: Packets, first_packet: int, turns: TurnAssembler) -> list[LaserScan]:
        samples = DECODERS[self._kind](packets)
        if not len(samples):
            return []
        self._count(self._counts, samples)
        index = first_packet * PACKET_SAMPLES[self._kind] + np.arange(len(samples))
        return turns.add(samples, index)

    @staticmethod
    def _count(counts: dict[str, int], samples: Samples) -> None:
        counts["samples"] += len(samples)
        counts["valid_samples"] += int(np.count_nonzero(samples.distance_q2))


def _inertia_limit_q6(step_q6: int) -> float:
    return _SPEED_UP * step_q6 + _SPEED_UP_SLACK_Q6
