"""What the lidar decoder makes of a damaged stream, held against the stream before the damage. Simulated.

The truth of each decoded sample is known because every damaged byte remembers where it came from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan
from drivers.rplidar_capsules import DECODERS, FULL_TURN_Q6, IntArray, Packets, Samples, decode_nodes
from drivers.rplidar_decoder import RplidarDecoder
from drivers.rplidar_framing import PacketFinder
from drivers.rplidar_protocol import PACKET_BYTES, PACKET_SAMPLES, Answer
from tools.byte_faults import Damaged, damage, expected_misses, most_likely_at_most
from tools.lidar_streams import STREAM_KINDS, StreamKind, encoded_stream, live_chunks

CAPSULE_KINDS = tuple(kind for kind in STREAM_KINDS if kind.answer != Answer.NODES)

_READ_S = 0.02
_NEAR_TURN = 1 / 18  # of a turn: a boundary so close to a true one is that one


@dataclass(frozen=True, slots=True)
class FaultCost:
    """One stream under one kind of fault.

    missed: damaged packets that were taken for sound; expected_missed: by theory, and what 99.9 % of runs stay at or
    below (capsules only). loss_per_hit: packets whose samples did not come per damaged packet, on the whole and in the
    worst stretch. false_turns: turns begun where none began; false_whole: scans called complete that are not.
    angles_off: samples decoded with an angle more than 2 deg wrong; wrong_distances, and how many are unavoidable
    (nodes of which only distance bytes were changed).
    """

    stream: str
    fault: str
    samples: int
    decoded: int
    packets: int
    hit_packets: int
    missed: int
    expected_missed: float | None
    missed_at_most: int | None
    loss_per_hit: float
    worst_loss_per_hit: float
    true_turns: int
    turns: int
    whole_turns: int
    false_turns: int
    false_whole: int
    angles_off: int
    largest_angle_error_deg: float
    wrong_distances: int
    unavoidable_distances: int


@dataclass(frozen=True, slots=True, eq=False)
class _Decoded:
    """What came out, in order: samples, the true index of each, and whether its packet was sound."""

    angle_q6: IntArray
    distance_q2: IntArray
    index: IntArray
    missed_packets: int


def fault_cost(kind: StreamKind, faults: tuple[str, ...], rate: float, samples: int, seed: int) -> FaultCost:
    """Damage a stream of this kind and compare what is decoded with what was sent."""
    packets = encoded_stream(kind, samples, seed)
    clean = packets.reshape(-1)
    damaged = damage(clean, rate, faults, seed + 1)
    truth = decode_nodes(packets) if kind.answer == Answer.NODES else DECODERS[kind.answer](packets)
    decoder = RplidarDecoder(kind.description)
    chunks = live_chunks(kind, damaged.data.tobytes(), _READ_S)
    scans = [scan for chunk in chunks for scan in decoder.feed(chunk)]
    decoded = _nodes(packets, damaged) if kind.answer == Answer.NODES else _capsules(kind, packets, damaged, scans)
    index = _indices_of(scans, decoded)
    hit = damaged.hit_packets(clean, PACKET_BYTES[kind.answer])
    came = np.zeros(len(packets), dtype=np.bool_)
    came[decoded.index // PACKET_SAMPLES[kind.answer]] = True
    last = int(np.flatnonzero(came)[-1])  # behind it the stream ends amid a turn
    loss, worst = _losses(came[:last], hit[:last])
    turns = _compared_turns(scans, index, truth.new_turn)
    off_q6 = np.abs(_turned_q6(decoded.angle_q6 - truth.angle_q6[decoded.index]))
    wrong = decoded.distance_q2 != truth.distance_q2[decoded.index]
    capsules = kind.answer != Answer.NODES
    expected = expected_misses(len(packets), PACKET_BYTES[kind.answer], rate, faults) if capsules else None
    return FaultCost(
        stream=kind.name, fault=faults[0] if len(faults) == 1 else "mixed", samples=len(truth), decoded=len(off_q6),
        packets=len(packets), hit_packets=int(hit.sum()), missed=decoded.missed_packets, expected_missed=expected,
        missed_at_most=None if expected is None else most_likely_at_most(expected),
        loss_per_hit=loss, worst_loss_per_hit=worst, true_turns=int(truth.new_turn.sum()), turns=len(scans),
        whole_turns=sum(scan.complete for scan in scans), false_turns=turns[0], false_whole=turns[1],
        angles_off=int((off_q6 > 2 * 64).sum()), largest_angle_error_deg=float(off_q6.max()) / 64,
        wrong_distances=int(wrong.sum()), unavoidable_distances=0 if capsules else _unavoidable(packets, damaged),
    )  # fmt: skip


def unnoticed_single_faults(kind: StreamKind, seed: int) -> tuple[int, int]:
    """Change each byte of a capsule to each other value: how many changes, and how many of them were not seen."""
    size = PACKET_BYTES[kind.answer]
    clean = encoded_stream(kind, 3 * PACKET_SAMPLES[kind.answer], seed).reshape(-1)
    unnoticed = 0
    for place in range(size, 2 * size):
        for change in range(1, 256):
            data = clean.copy()
            data[place] ^= change
            found = PacketFinder(kind.answer).find(data.tobytes()).runs
            unnoticed += any(run.start < 2 * size and run.end > size for run in found)
    return size * 255, unnoticed


def _nodes(packets: Packets, damaged: Damaged) -> _Decoded:
    """Nodes that were found; a node is the one of which the angle's first byte is."""
    starts = _starts(damaged, Answer.NODES)
    found = np.stack([damaged.data[starts + place] for place in range(5)], axis=1)
    samples = decode_nodes(found)
    origin = np.where(damaged.origin[starts + 1] >= 0, damaged.origin[starts + 1], damaged.origin[starts + 2])
    index = origin // 5
    return _Decoded(samples.angle_q6, samples.distance_q2, index, int((found != packets[index]).any(axis=1).sum()))


def _capsules(kind: StreamKind, packets: Packets, damaged: Damaged, scans: list[LaserScan]) -> _Decoded:
    """Match what came out, capsule by capsule, with what the capsules found give in pairs."""
    size, per_packet = PACKET_BYTES[kind.answer], PACKET_SAMPLES[kind.answer]
    starts = _starts(damaged, kind.answer)
    found = damaged.data[starts[:, None] + np.arange(size)]
    origin = damaged.origin[starts[:, None] + np.arange(size)]
    index = np.maximum(origin.max(axis=1), 0) // size
    missed = int((found != packets[index]).any(axis=1).sum())
    angles_q6, distances_q2 = _as_sent(scans)
    parts: list[Samples] = []
    sent: list[int] = []
    at = 0
    for pair in np.flatnonzero(np.diff(starts) == size).tolist():
        samples = DECODERS[kind.answer](found[pair : pair + 2])
        block = slice(at, at + per_packet)
        here = len(angles_q6[block])
        if not here or (samples.angle_q6[:here] != angles_q6[block]).any():
            continue  # refused for its step, or behind the last turn that came out
        if (samples.distance_q2[:here] != distances_q2[block]).any():
            continue
        parts.append(samples.part(0, here))
        sent.append(int(index[pair]))
        at += here
    if at != len(angles_q6):
        raise AssertionError(f"{len(angles_q6) - at} samples came from no capsule that was found")
    counts = [len(part) for part in parts]
    within = np.concatenate([np.arange(count) for count in counts])
    return _Decoded(
        np.concatenate([part.angle_q6 for part in parts]),
        np.concatenate([part.distance_q2 for part in parts]),
        np.repeat(np.array(sent), counts) * per_packet + within,
        missed,
    )


def _starts(damaged: Damaged, kind: Answer) -> IntArray:
    """(F,) where the packets found in the damaged bytes begin."""
    size = PACKET_BYTES[kind]
    runs = PacketFinder(kind).find(damaged.data.tobytes()).runs
    return np.concatenate([run.start + size * np.arange(len(run.packets)) for run in runs])


def _as_sent(scans: list[LaserScan]) -> tuple[IntArray, IntArray]:
    """Angles clockwise in 1/64 deg and distances in 1/4 mm, as they were before they became scans."""
    angles = np.concatenate([scan.angles_rad for scan in scans])
    ranges = np.concatenate([scan.ranges_m for scan in scans])
    angles_q6 = np.rint(-angles * (FULL_TURN_Q6 / (2 * np.pi))).astype(np.int64) % FULL_TURN_Q6
    return angles_q6, np.rint(ranges * 4000).astype(np.int64)


def _indices_of(scans: list[LaserScan], decoded: _Decoded) -> list[IntArray]:
    """Return the true indices of each scan's samples; what was found and what came out must agree."""
    angles_q6, _ = _as_sent(scans)
    if (angles_q6 != decoded.angle_q6[: len(angles_q6)]).any():
        raise AssertionError("the scans hold other samples than the packets found")
    edges = np.cumsum([len(scan.ranges_m) for scan in scans])
    return np.split(decoded.index[: edges[-1]], edges[:-1])


def _losses(came: NDArray[np.bool_], hit: NDArray[np.bool_]) -> tuple[float, float]:
    """Lost packets per damaged one: on the whole, and the most over stretches in which none came."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], ~came, [0])).astype(np.int64)))
    starts, stops = edges[::2], edges[1::2]
    # The damage may lie in the packet beside a stretch: taken for sound before it, or sharing its loss behind it.
    hits = [max(int(hit[max(start - 1, 0) : stop + 1].sum()), 1) for start, stop in zip(starts, stops, strict=True)]
    ratios = (stops - starts) / np.array(hits, dtype=np.float64) if len(starts) else np.zeros(1)
    return float((~came).sum() / max(int(hit.sum()), 1)), float(ratios.max())


def _compared_turns(scans: list[LaserScan], index: list[IntArray], new_turn: NDArray[np.bool_]) -> tuple[int, int]:
    """Count the turns begun where none begins, and the scans called complete that are not a whole turn."""
    begins = np.flatnonzero(new_turn)
    near = float(np.diff(begins).mean()) * _NEAR_TURN
    taken: set[int] = set()
    false_turns = false_whole = 0
    for scan, samples, before in zip(scans[1:], index[1:], index[:-1], strict=True):
        # The boundary lies between the last sample before and the first here: in a gap it may be anywhere.
        inside = np.flatnonzero((begins >= before[-1] + 1 - near) & (begins <= samples[0] + near)).tolist()
        free = [place for place in inside if place not in taken]
        false_turns += not free
        taken.update(free[:1])
        whole = samples[0] in begins and samples[-1] + 1 in begins and len(samples) == samples[-1] - samples[0] + 1
        whole = whole and int(np.isin(begins, samples).sum()) == 1
        false_whole += scan.complete and not whole
    return false_turns, false_whole + scans[0].complete


def _unavoidable(packets: Packets, damaged: Damaged) -> int:
    """Nodes that came in one piece, with nothing but a distance byte changed: nothing in the protocol tells them."""
    kept = damaged.origin >= 0
    changed = np.zeros(packets.size, dtype=np.bool_)
    changed[damaged.origin[kept]] = damaged.data[kept] != packets.reshape(-1)[damaged.origin[kept]]
    by_byte = changed.reshape(-1, 5)
    return int((by_byte[:, 3:].any(axis=1) & ~by_byte[:, :3].any(axis=1)).sum())


def _turned_q6(angle_q6: IntArray) -> IntArray:
    half = FULL_TURN_Q6 // 2
    return (angle_q6 + half) % FULL_TURN_Q6 - half
