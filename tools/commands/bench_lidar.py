"""`mapfuse-robot bench lidar`: what decoding an RPLIDAR costs, beside other drivers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import Json, Seed, finite, print_json

if TYPE_CHECKING:
    from tools.lidar_bench import DecodingSpeed, LiveShare


def lidar(
    samples: Annotated[int, typer.Option(min=10_000, help="Samples a stream in memory.")] = 200_000,
    seconds: Annotated[
        float,
        typer.Option(metavar="S", min=0.0, max=600.0, callback=finite, help="How long each runs live; 0: not at all."),
    ] = 10.0,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Measure decoding in memory, every answer type, and the CPU share live at 16,000 samples a second.

    SIMULATED streams of a room; live over the emulator's pseudo-terminal, which has a process of its own. pyrplidar and
    rplidar-roboticia are measured beside where they are installed (extra `bench`). In memory our decoder gets the
    bytes as a host that reads every 100 ms or 10 ms does; the peers take theirs at once.
    """
    from dataclasses import asdict

    from tools.lidar_bench import decoding_speeds, live_shares
    from tools.lidar_peers import PEERS, installed_peers

    speeds = decoding_speeds(samples, seed)
    shares = live_shares(seconds) if seconds > 0 else []
    missing = [peer for peer in PEERS if peer not in installed_peers()]
    if as_json:
        found = {"speeds": [asdict(speed) for speed in speeds], "live": [asdict(share) for share in shares]}
        print_json({"simulated": True, **found, "missing_peers": missing})
        return
    typer.echo(f"mapfuse-robot bench lidar --samples {samples} --seconds {seconds:g} --seed {seed}  (simulated)")
    for line in (*_speed_lines(speeds), *_live_lines(shares)):
        typer.echo(line)
    for peer in missing:
        typer.echo(f"{peer} is not installed: not measured (pip install 'mapfuse-robot[bench]')")


def _speed_lines(speeds: list[DecodingSpeed]) -> list[str]:
    reads_s, peers = list(speeds[0].by_read_s), list(speeds[0].peers)
    head = "".join(f"{f'read every {1000 * read_s:.0f} ms':>20}" for read_s in reads_s)
    lines = ["million samples a CPU second, in memory, best of several"]
    lines.append(f"  {'stream':<16}{head}{''.join(f'{peer:>20}' for peer in peers)}{'ours to best peer':>20}")
    for speed in speeds:
        ours = [speed.by_read_s[read_s] for read_s in reads_s]
        others = [speed.peers[peer] for peer in peers]
        best = max((rate for rate in others if rate is not None), default=None)
        cells = "".join("-".rjust(20) if rate is None else f"{rate / 1e6:>20.2f}" for rate in (*ours, *others))
        ratios = "-" if best is None else " ".join(f"{rate / best:.1f}x" for rate in ours)
        lines.append(f"  {speed.stream:<16}{cells}{ratios:>20}")
    return lines


def _live_lines(shares: list[LiveShare]) -> list[str]:
    if not shares:
        return []
    return [
        "live at the emulator's pseudo-terminal: share of a core, samples a second",
        *(f"  {one.driver:<18} {one.cpu_share:>6.1%} {one.samples_per_s:>8.0f}   {one.mode}" for one in shares),
    ]
