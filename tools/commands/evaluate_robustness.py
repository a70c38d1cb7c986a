"""`mapfuse-robot evaluate robustness`: wrong loop closures and faults of the input against ground truth."""

from __future__ import annotations

import logging
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, Seed, load_config, print_json
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.results import Report

log = logging.getLogger(__name__)


class Part(str, Enum):
    """What is measured."""

    closures = "closures"
    faults = "faults"


def robustness(
    recording: Annotated[Path, typer.Argument(metavar="LOG", help="A recording with laser scans.")],
    relations: Annotated[Path, typer.Argument(metavar="RELATIONS", help="True relative poses of the same log.")],
    only: Annotated[Part | None, typer.Option("--only", help="One part of it. [default: both]")] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", metavar="S", min=1.0, help="Take only the beginning of the log.")
    ] = None,
    config: ConfigFile = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Map LOG with wrong loop closures injected and with faults put into it, and compare with RELATIONS.

    Wrong closures: 100 random ones, and 5 groups of 10 that agree with each other. Faults: scans missing, no odometry,
    a blind laser, glass, a kidnapped robot, clock jumps. Exit code 1: one of them bent the map.
    """
    from mapping.relations import read_relations
    from tools.slam_robustness import evaluate_robustness, read_log

    parts = [part.value for part in Part if only in {None, part}]
    truth = read_relations(relations)
    sound = read_log(recording, load_config(config), seconds)
    report = evaluate_robustness(sound, truth, parts, seed, log.info)
    if as_json:
        print_json(report)
    else:
        _print_closures(report.get("closures", []))
        _print_faults(report.get("faults", []))
    bent = any(row["bent"] for part in parts for row in report[part])
    raise typer.Exit(ExitCode.FAILED if bent else ExitCode.OK)


def _print_closures(rows: list[Report]) -> None:
    if rows:
        typer.echo(
            f"{'wrong closures':26} {'believed':>10} {'graph m':>8} {'deg':>6} {'refined m':>10} {'deg':>6}"
            f" {'change':>8}"
        )
    for row in rows:
        believed = f"{row['wrong_believed']} of {row['injected']}"
        typer.echo(
            f"{row['case']:26} {believed:>10} {row['graph_m']:8.4f} {row['graph_deg']:6.3f} {row['refined_m']:10.4f}"
            f" {row['refined_deg']:6.3f} {row['change']:+8.1%}{'  BENT' if row['bent'] else ''}"
        )


def _print_faults(rows: list[Report]) -> None:
    if rows:
        typer.echo(f"{'fault':36} {'in map':>6} {'m':>7} {'deg':>6} {'max m':>6} {'sound m':>8} {'deg':>6}  verdict")
    for row in rows:
        lost = ", ".join(f"{piece['from_s']:.0f}-{piece['to_s']:.0f} s" for piece in row["not_in_map"])
        typer.echo(
            f"{row['case']:36} {row['scans_in_map']:6} {row['mean_m']:7.4f} {row['mean_deg']:6.3f} {row['max_m']:6.3f}"
            f" {row['sound_mean_m']:8.4f} {row['sound_mean_deg']:6.3f}  {row['verdict']}{f' ({lost})' if lost else ''}"
        )
