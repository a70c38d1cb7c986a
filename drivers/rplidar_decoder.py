"""Raw chunks of an RPLIDAR's port to laser scans: a pure function of the stream's description and the chunks.

No clock is asked, so a recorded stream decodes to the scans that it gave live, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.errors import DeviceFaultError
from drivers.messages import LaserScan, LidarStream, RawChunk
from drivers.rplidar_capsule_steps import BROKEN, RESTARTED, judge_steps
from drivers.rplidar_capsules import DECODERS, FULL_TURN_Q6, Samples, as_packets, decode_nodes, start_q6
from drivers.rplidar_framing import PacketFinder, PacketRun
from drivers.rplidar_node_turns import NodePiece, NodeTurns
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
        self._size = PACKET_BYTES[self._kind]
        self._per_packet = PACKET_SAMPLES[self._kind]
        self._packet_s = self._per_packet * stream.sample_us * 1e-6
        self._limit_q6 = round(self._packet_s * _FASTEST_TURN_HZ * FULL_TURN_Q6)
        self._byte_s = BITS_PER_BYTE / stream.baud
        self._slow_line = self._size * self._byte_s > self._packet_s
        self._latency_s = packet_latency_s(stream.sample_us * 1e-6, self._size, stream.baud)
        self._clock = SampleClock(stream.sample_us * 1e-6)
        self._stream = stream
        self._turns: TurnAssembler | None = None
        self._epoch_ns = 0
        self._finder = PacketFinder(self._kind)
        self._pending = b""  # bytes not settled yet
        self._maybe_descriptor = True
        self._skipped = 0  # bytes between the last sound packet and the pending ones
        self._node_turns = NodeTurns()
        self._held = b""  # capsules that wait for their turn's end
        self._step_q6 = -1  # the last sound step of the head from capsule to capsule
        self._head_q6 = 0  # behind the last samples
        self._next_packet = 0
        self._next_sample = 0  # of the nodes whose turns are settled
        self._counts = dict.fromkeys(DecoderCounters.__slots__, 0)

    @property
    def counters(self) -> DecoderCounters:
        """A snapshot of the counters."""
        counts = dict(self._counts)
        if self._kind == Answer.NODES:
            self._count(counts, decode_nodes(self._node_turns.held))
        elif self._held:
            self._count(counts, DECODERS[self._kind](as_packets(self._held, self._size)))
        return DecoderCounters(**counts)

    def feed(self, chunk: RawChunk) -> list[LaserScan]:
        """Take the next chunk; return the turns that are over, oldest first, the first partial one included."""
        if self._turns is None:
            self._epoch_ns = chunk.stamp_ns
            self._turns = TurnAssembler(self._stream, self._clock, chunk.stamp_ns)
        self._pending += chunk.data
        if self._maybe_descriptor and not self._strip_descriptor():
            return []
        framing = self._finder.find(self._pending)
        scans: list[LaserScan] = []
        settled = 0
        end_s = (chunk.stamp_ns - self._epoch_ns) * 1e-9 - self._latency_s
        for run in framing.runs:
            self._skip(run.start - settled)
            scans += self._take(run, end_s, self._turns)
            settled = run.end
        self._skip(framing.used - settled)
        self._pending = self._pending[framing.used :]
        for scan in scans:
            self._counts["scans"] += 1
            self._counts["partial_scans"] += not scan.complete
        return scans

    def _strip_descriptor(self) -> bool:
        """Drop the stream's own descriptor if the bytes begin with it; False while that cannot be told yet."""
        whole = Descriptor(self._size, repeats=True, kind=self._kind).encode()
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

    def _take(self, run: PacketRun, end_s: float, turns: TurnAssembler) -> list[LaserScan]:
        """Decode a run of sound packets; end_s: a sample whose packet the chunk ends with was taken not later."""
        scans = self._bridge_damage(turns) if self._skipped else []
        first = self._next_packet
        self._next_packet += run.length
        self._counts["packets"] += run.length
        if self._kind == Answer.NODES:
            self._observe(run, first, 0, run.length, end_s)
            return scans + self._add_nodes(self._node_turns.take(run.data), turns)
        return scans + self._take_capsules(run, first, end_s, turns)

    def _observe(self, run: PacketRun, first: int, start: int, stop: int, end_s: float) -> None:
        """Tell the clock of packets start to stop of a run.

        They come evenly, so one says all: the last, or on a line that is slower than the sensor the first.
        """
        place = start if self._slow_line else stop - 1
        behind = len(self._pending) - run.start - (place + 1) * self._size
        self._clock.observe((first + place + 1) * self._per_packet - 1, end_s - behind * self._byte_s)

    def _bridge_damage(self, turns: TurnAssembler) -> list[LaserScan]:
        """Carry on after skipped bytes; a byte lost or gained leaves no doubt how many packets they were.

        Returns what the capsules that waited complete: a turn that took too long.
        """
        lost = round(self._skipped / self._size)
        unclear = abs(self._skipped - lost * self._size) > max(1, self._size // 8)
        self._skipped = 0
        if self._next_packet == 0:
            return []
        if self._kind == Answer.NODES:
            scans = self._add_nodes(self._node_turns.gap(), turns)
        else:
            scans = self._decode(self._held, self._next_packet - len(self._held) // self._size, turns)
        self._counts["rejected_packets"] += max(1, lost)
        self._next_packet += lost
        self._next_sample = self._next_packet
        self._break(turns, restart_clock=unclear)
        return scans

    def _break(self, turns: TurnAssembler, *, restart_clock: bool) -> None:
        turns.gap()
        self._held = b""
        if restart_clock:
            turns.fix_times()
            self._clock.restart()

    def _add_nodes(self, pieces: list[NodePiece], turns: TurnAssembler) -> list[LaserScan]:
        scans: list[LaserScan] = []
        for piece in pieces:
            samples = decode_nodes(piece.packets)
            self._count(self._counts, samples)
            scans += turns.extend(samples, self._next_sample)
            self._next_sample += len(samples)
            if piece.ends_turn:
                scans += turns.end_turn(guessed=piece.guessed)
        return scans

    def _take_capsules(self, run: PacketRun, first: int, end_s: float, turns: TurnAssembler) -> list[LaserScan]:
        """Settle capsules up to the last, whose samples depend on the next; decode them once a turn is over."""
        held = len(self._held) // self._size
        stack = self._held + run.data
        last = held + run.length - 1
        first_held = first - held
        settled = max(held - 1, 0)  # steps known from before
        verdicts = np.zeros(last - settled, dtype=np.int64)
        passes_zero, unsound, self._step_q6 = judge_steps(
            stack, self._size, settled, self._step_q6, self._limit_q6, verdicts
        )
        cuts = np.flatnonzero(verdicts).tolist() if unsound else []
        waits = (last + 1) * self._packet_s <= _LONGEST_WAIT_S
        if not (cuts or passes_zero or turns.after_gap) and waits:
            self._observe(run, first, 0, run.length, end_s)
            self._held = stack
            return []
        scans: list[LaserScan] = []
        start = observed = 0
        for cut in (*(place + settled for place in cuts), last):
            known = cut + 1 - held  # packets of this run up to the cut
            if known > observed:
                self._observe(run, first, observed, known, end_s)
                observed = known
            scans += self._decode(stack[start * self._size : (cut + 1) * self._size], first_held + start, turns)
            start = cut + 1
            if cut == last:
                break
            self._counts["rejected_packets"] += verdicts[cut - settled] == BROKEN
            self._break(turns, restart_clock=True)
            if verdicts[cut - settled] == RESTARTED:
                turns.discard()
        self._held = stack[last * self._size :]
        return scans

    def _decode(self, capsules: bytes, first_packet: int, turns: TurnAssembler) -> list[LaserScan]:
        if len(capsules) < 2 * self._size:
            return []
        packets = as_packets(capsules, self._size)
        samples = DECODERS[self._kind](packets)
        self._count(self._counts, samples)
        passed_zero = turns.after_gap and start_q6(packets, 0) < self._head_q6
        scans = turns.end_turn(guessed=True) if passed_zero else []
        self._head_q6 = start_q6(packets, len(packets) - 1)
        return scans + turns.add(samples, first_packet * self._per_packet)

    @staticmethod
    def _count(counts: dict[str, int], samples: Samples) -> None:
        counts["samples"] += len(samples)
        counts["valid_samples"] += int(np.count_nonzero(samples.distance_q2))


def load_compiled() -> None:
    """Load all compiled code that decoding uses, so that no stream waits for it; the first time ever takes a while."""
    for kind in map(Answer, DECODERS):
        blank = bytes(2 * PACKET_BYTES[kind])
        PacketFinder(kind).find(blank)
        DECODERS[kind](as_packets(blank, PACKET_BYTES[kind]))
        if kind == Answer.NODES:
            NodeTurns().take(blank)
        else:
            judge_steps(blank, PACKET_BYTES[kind], 0, -1, 0, np.zeros(1, dtype=np.int64))
