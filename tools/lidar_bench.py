"""What decoding an RPLIDAR costs, in memory and live, beside other Python drivers in the same run. Simulated."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.messages import RawChunk
from drivers.rplidar import open_rplidar
from drivers.rplidar_decoder import RplidarDecoder, load_compiled
from drivers.rplidar_models import MODELS
from tools.errors import ToolError
from tools.lidar_peers import can_decode, installed_peers, peer_live, peer_rate
from tools.lidar_streams import STREAM_KINDS, StreamKind, encoded_stream, live_chunks
from tools.processes import in_own_process

READS_S = (0.1, 0.01)
_REPEATS = 15  # the best counts: other programs only make it slower
_PEER_SHARE = 8  # peers get every so manieth part of the stream, being slow
_PEER_REPEATS = 5
_LIVE_MODEL, _LIVE_MODE = "A2M12", "Sensitivity"
_PEER_MODES = {"pyrplidar": (3, "ultra 16 kS/s"), "rplidar-roboticia": (0, "express 4 kS/s, it has no faster")}
_WARM_S = 1.0


@dataclass(frozen=True, slots=True)
class DecodingSpeed:
    """Samples per CPU second in memory: ours by the time between two reads, and each peer's, None: it cannot."""

    stream: str
    by_read_s: dict[float, float]
    peers: dict[str, float | None]


@dataclass(frozen=True, slots=True)
class LiveShare:
    """A driver at the emulator's pseudo-terminal: its process's share of a core, and samples a second."""

    driver: str
    mode: str
    cpu_share: float
    samples_per_s: float


def decoding_speeds(samples: int, seed: int) -> list[DecodingSpeed]:
    """Measure every answer type in memory, ours and the peers that are installed."""
    load_compiled()
    return [_decoding_speed(kind, samples, seed) for kind in STREAM_KINDS]


def live_shares(seconds: float) -> list[LiveShare]:
    """Measure our driver and the peers at an emulated sensor of 16 kS/s, each in a process of its own."""
    model = MODELS[_LIVE_MODEL]
    shares = []
    with _emulator() as port:
        share, samples = in_own_process(live_cost, port, seconds)
        shares.append(LiveShare("mapfuse-robot", "ultra 16 kS/s", share, samples / seconds))
    for peer in installed_peers():
        mode_id, name = _PEER_MODES[peer]
        with _emulator() as port:
            share, samples = in_own_process(peer_live, peer, port, model.baud, mode_id, _WARM_S, seconds)
        shares.append(LiveShare(peer, name, share, samples / seconds))
    return shares


def live_cost(port: str, seconds: float) -> tuple[float, int]:
    """CPU share of a core and decoded samples of our driver and decoder at a port, once it runs."""
    load_compiled()
    begun: tuple[float, float, int] | None = None
    with open_rplidar(port) as sensor:
        decoder = RplidarDecoder(sensor.start(_LIVE_MODE))
        ready_s = float("inf")
        for message in sensor:
            now_s = time.monotonic()
            if isinstance(message, RawChunk) and message.data:
                decoder.feed(message)
                ready_s = min(ready_s, now_s + _WARM_S)
            if begun is None and now_s >= ready_s:
                begun = now_s, time.process_time(), decoder.counters.samples
            elif begun is not None and now_s - begun[0] >= seconds:
                break
        if begun is None:
            raise ToolError(f"{port}: the emulator's stream ended before it was measured: try again")
        share = (time.process_time() - begun[1]) / (time.monotonic() - begun[0])
        return share, decoder.counters.samples - begun[2]


def _decoding_speed(kind: StreamKind, samples: int, seed: int) -> DecodingSpeed:
    packets = encoded_stream(kind, samples, seed)
    data = packets.tobytes()
    part = packets[: len(packets) // _PEER_SHARE].tobytes()
    return DecodingSpeed(
        stream=kind.name,
        by_read_s={read_s: max(_rate(kind, data, read_s) for _ in range(_REPEATS)) for read_s in READS_S},
        peers={
            peer: max(peer_rate(peer, kind.answer, part) for _ in range(_PEER_REPEATS))
            if can_decode(peer, kind.answer)
            else None
            for peer in installed_peers()
        },
    )


def _rate(kind: StreamKind, data: bytes, read_s: float) -> float:
    chunks = live_chunks(kind, data, read_s)
    decoder = RplidarDecoder(kind.description)
    began = time.process_time()
    for chunk in chunks:
        decoder.feed(chunk)
    passed_s = time.process_time() - began
    return decoder.counters.samples / passed_s


@contextmanager
def _emulator() -> Iterator[str]:
    """Serve an emulated sensor in a process of its own; yields its port."""
    command = [sys.executable, "-m", "tools.cli", "emulate", "lidar", "--model", _LIVE_MODEL, "--json"]
    command += ["--pose", "1.6", "3.6", "0.3"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603 - our own command
        try:
            line = process.stdout.readline() if process.stdout else ""
            if not line:
                raise ToolError("the emulator did not start: run `mapfuse-robot emulate lidar` to see why")
            yield str(json.loads(line)["address"])
        finally:
            process.terminate()
