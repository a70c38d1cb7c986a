"""`mapfuse-robot evaluate lidar`: what the lidar decoder makes of a bad line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import Json, Seed, finite, print_json

if TYPE_CHECKING:
    from tools.lidar_faults import FaultCost


def lidar(
    samples: Annotated[int, typer.Option(min=5_000, help="Samples a stream.")] = 100_000,
    rate: Annotated[
        float, typer.Option(min=0.0, max=0.2, callback=finite, help="Share of the bytes that suffer a fault.")
    ] = 0.002,
    fuzz: Annotated[
        float,
        typer.Option(
            metavar="S", min=0.0, callback=finite, help="Instead, feed noise of all sorts for so many seconds."
        ),
    ] = 0.0,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Damage streams of every answer type and compare what is decoded with what was sent. SIMULATED.

    Faults: bytes replaced, single bits flipped, bytes lost, bytes added, and all four mixed. Besides, each byte of a
    capsule is changed to each other value, alone. With --fuzz: noise, streams in pieces and unsound answers; any
    exception but the declared ones ends the run with a traceback.
    """
    from dataclasses import asdict

    if fuzz > 0:
        from tools.lidar_fuzz import fuzz as run_fuzz

        report = run_fuzz(fuzz, seed)
        if as_json:
            print_json(asdict(report))
        else:
            typer.echo(f"mapfuse-robot evaluate lidar --fuzz {fuzz:g} --seed {seed}  (noise, no sensor)")
            typer.echo(
                f"  {report.streams} streams, {report.bytes} bytes, {report.scans} scans; {report.answers} answers,"
                f" {report.refused} refused as declared; no other exception, cut or whole the same samples"
            )
        return
    from tools.byte_faults import FAULTS
    from tools.lidar_faults import CAPSULE_KINDS, fault_cost, unnoticed_single_faults
    from tools.lidar_streams import STREAM_KINDS

    kinds = [*((fault,) for fault in FAULTS), FAULTS]
    costs = [fault_cost(kind, faults, rate, samples, seed) for kind in STREAM_KINDS for faults in kinds]
    single = {kind.name: unnoticed_single_faults(kind, seed) for kind in CAPSULE_KINDS}
    if as_json:
        faults = {name: {"changes": changes, "unnoticed": unnoticed} for name, (changes, unnoticed) in single.items()}
        print_json({"simulated": True, "rate": rate, "costs": [asdict(cost) for cost in costs], "single": faults})
        return
    typer.echo(f"mapfuse-robot evaluate lidar --samples {samples} --rate {rate:g} --seed {seed}  (simulated)")
    for line in _lines(costs):
        typer.echo(line)
    for name, (changes, unnoticed) in single.items():
        typer.echo(f"{name}: {changes} changes of a single byte of a capsule, {unnoticed} not noticed")


def _lines(costs: list[FaultCost]) -> list[str]:
    titles = ("decoded", "packets hit", "lost a hit", "turns", "whole", "false", "angle error", "wrong distances")
    lines = [
        "decoded: share of the samples; lost a hit: packets lost per damaged packet, and in the worst stretch; turns:",
        "true and found; false: turns begun where none began, and scans wrongly called whole; angle error: largest,",
        "in deg, and samples more than 2 deg off; wrong distances: of standard nodes, beside the unavoidable; missed:",
        "damaged capsules taken for sound, beside the mean by XOR theory (99.9 % of runs stay at or below the third)",
        f"  {'stream':<16}{'fault':<10}" + "".join(f"{title:>16}" for title in (*titles, "missed")),
    ]
    for cost in costs:
        cells = (
            f"{cost.decoded / cost.samples:.1%}",
            f"{cost.hit_packets}/{cost.packets}",
            f"{cost.loss_per_hit:.2f} {cost.worst_loss_per_hit:.1f}",
            f"{cost.true_turns} {cost.turns}",
            f"{cost.whole_turns}",
            f"{cost.false_turns} {cost.false_whole}",
            f"{cost.largest_angle_error_deg:.2f} {cost.angles_off}",
            f"{cost.wrong_distances}" if cost.expected_missed is not None else _beside_floor(cost),
            "-" if cost.expected_missed is None else f"{cost.missed} {cost.expected_missed:.2f} {cost.missed_at_most}",
        )
        lines.append(f"  {cost.stream:<16}{cost.fault:<10}" + "".join(f"{cell:>16}" for cell in cells))
    return lines


def _beside_floor(cost: FaultCost) -> str:
    return f"{cost.wrong_distances} of {cost.unavoidable_distances}"
