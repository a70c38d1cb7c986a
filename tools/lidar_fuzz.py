"""Noise for the lidar's decoder and for the parsers of its answers: nothing but the declared errors may come of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivers.errors import DeviceFaultError
from drivers.messages import LaserScan, RawChunk
from drivers.rplidar_decoder import RplidarDecoder
from drivers.rplidar_protocol import (
    ANSWER_SYNC,
    Answer,
    Conf,
    Descriptor,
    conf_value,
    find_descriptor,
    parse_health,
    parse_info,
    parse_name,
    parse_q8,
    parse_sample_rate,
    parse_u8,
    parse_u16,
)
from tools.byte_faults import FAULTS, damage
from tools.errors import ToolError
from tools.lidar_streams import STREAM_KINDS, StreamKind, encoded_stream

_PARSERS: tuple[Callable[[bytes], object], ...] = (
    parse_info,
    parse_health,
    parse_sample_rate,
    parse_name,
    lambda payload: parse_u8(payload, "u8"),
    lambda payload: parse_u16(payload, "u16"),
    lambda payload: parse_q8(payload, "q8"),
    lambda payload: conf_value(payload, Conf.MODE_COUNT),
)
_MOST_PACKETS = 300
_PARSED_PER_STREAM = 20


@dataclass(frozen=True, slots=True)
class FuzzReport:
    """What was fed: streams with their bytes, the scans that came of them, answers parsed and how many were refused."""

    seconds: float
    streams: int
    bytes: int
    scans: int
    answers: int
    refused: int


def fuzz(seconds: float, seed: int) -> FuzzReport:
    """Feed noise for so long. An undeclared exception comes through; ToolError for a result that cannot be.

    Both are repeated by the same seed: what is fed does not depend on how fast it went.
    """
    random = np.random.default_rng(seed)
    began = time.monotonic()
    streams = fed = scans = answers = refused = 0
    while (passed := time.monotonic() - began) < seconds or not streams:
        kind = STREAM_KINDS[random.integers(len(STREAM_KINDS))]
        data = noise(kind, random)
        scans += decode_noise(kind, data, random)
        streams += 1
        fed += len(data)
        for _ in range(_PARSED_PER_STREAM):
            refused += parse_noise(random)
            answers += 1
    return FuzzReport(passed, streams, fed, scans, answers, refused)


def noise(kind: StreamKind, random: np.random.Generator) -> bytes:
    """Bytes of one of several sorts: plain noise, a stream with few or many faults, pieces of streams and of noise."""
    sort = random.integers(4)
    if sort == 0:
        return random.bytes(int(random.integers(0, 5000)))
    seed = int(random.integers(2**32))
    clean = encoded_stream(kind, int(random.integers(1, _MOST_PACKETS)) * 20, seed).reshape(-1)
    if sort == 1:
        return damage(clean, float(random.choice((0.0, 0.002, 0.05, 0.3))), FAULTS, seed).data.tobytes()
    edges = np.sort(random.integers(0, len(clean), 12))
    pieces = [clean[start:stop].tobytes() for start, stop in pairwise(edges)]
    if sort == 2:
        random.shuffle(pieces)
        return b"".join(pieces)
    begin = Descriptor(len(clean) % 300, repeats=True, kind=kind.answer).encode()
    return begin + b"".join(piece + random.bytes(int(random.integers(0, 60))) for piece in pieces)


def decode_noise(kind: StreamKind, data: bytes, random: np.random.Generator) -> int:
    """Decode in one piece and in many; return the number of scans, or raise ToolError where the two differ or lie.

    How long a gap was is told by the times at which chunks came, so those that are compared came at once; the same
    chunks at times that make no sense have to give scans that make sense.
    """
    whole = RplidarDecoder(kind.description).feed(RawChunk(0, data))
    edges = [0, *np.sort(random.integers(0, len(data) + 1, int(random.integers(0, 60)))).tolist(), len(data)]
    steps_ns = [int(random.integers(0, 10 ** int(random.integers(1, 11)))) for _ in edges[1:]]
    at_once, spread = (
        _decoded_in_pieces(kind, data, edges, stamps_ns)
        for stamps_ns in ([0] * len(steps_ns), np.cumsum(steps_ns).tolist())
    )
    check_scans(spread)
    together, apart = (_content(result) for result in (whole, at_once))
    shortest = min(len(one[0]) for one in (together, apart))
    if not all(np.array_equal(one[:shortest], other[:shortest]) for one, other in zip(together, apart, strict=True)):
        raise ToolError(f"{kind.name}: {len(data)} bytes give other samples when they are cut at {edges[1:-1]}")
    return len(spread)


def _decoded_in_pieces(kind: StreamKind, data: bytes, edges: list[int], stamps_ns: list[int]) -> list[LaserScan]:
    decoder = RplidarDecoder(kind.description)
    return [
        scan
        for (start, stop), stamp_ns in zip(pairwise(edges), stamps_ns, strict=True)
        for scan in decoder.feed(RawChunk(stamp_ns, data[start:stop]))
    ]


def _content(scans: list[LaserScan]) -> tuple[np.ndarray, np.ndarray]:
    angles = [scan.angles_rad for scan in scans]
    ranges = [scan.ranges_m for scan in scans]
    return np.concatenate([np.zeros(0), *angles]), np.concatenate([np.zeros(0), *ranges])


def check_scans(scans: list[LaserScan]) -> None:
    """Raise ToolError for an angle, a range or times that no sensor gives."""
    newest = -np.inf
    for scan in scans:
        sound = (
            (np.abs(scan.angles_rad) <= np.pi).all()
            and ((scan.ranges_m >= 0) & (scan.ranges_m < 66.0)).all()
            and (np.diff(scan.offsets_s) > 0).all()
            and scan.stamp_ns >= newest
        )
        if not sound:
            raise ToolError(f"a scan at {scan.stamp_ns} ns has an angle, a range or times that cannot be")
        newest = scan.stamp_ns + scan.offsets_s[-1] * 1e9 - 1


def parse_noise(random: np.random.Generator) -> bool:
    """Search noise for a descriptor and parse an answer of noise; return whether it was refused, as declared."""
    data = bytearray(random.bytes(int(random.integers(0, 80))))
    for _ in range(int(random.integers(0, 3))):
        at = int(random.integers(0, len(data) + 1))
        length = int(random.choice((0, 3, 5, 20, 84, 132, 255, 2**30 - 1)))
        answer = int(random.choice([kind.value for kind in Answer]))
        data[at:at] = Descriptor(length, bool(random.integers(2)), answer).encode()
        data[at:at] = ANSWER_SYNC[: int(random.integers(0, 3))]
    wanted = int(random.choice([kind.value for kind in Answer]))
    size = None if random.integers(2) else int(random.integers(0, 256))
    found = find_descriptor(bytes(data), wanted, repeats=bool(random.integers(2)), size=size)
    if found is not None and not (found[0].kind == wanted and 7 <= found[1] <= len(data)):
        raise ToolError(f"a descriptor was found where there is none, in {data.hex()}")
    payload = random.bytes(int(random.integers(0, 30)))
    try:
        _PARSERS[random.integers(len(_PARSERS))](payload)
    except DeviceFaultError:
        return True
    return False
