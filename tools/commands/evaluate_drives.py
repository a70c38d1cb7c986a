"""`mapfuse-robot evaluate drives`: the closed loop in the simulator."""

from __future__ import annotations

import logging
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, print_json
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def drives(
    count: Annotated[int, typer.Option("-n", "--drives", min=0, help="Drives to a goal.")] = 20,
    stops: Annotated[int, typer.Option(min=0, help="Stops on the way, of each kind.")] = 20,
    boxes: Annotated[int, typer.Option(min=0, help="Drives on whose path a box is put.")] = 20,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drive a simulated car by its emulated lidar's bytes: map the office, then plan, drive, arrive, and stop.

    The pose is that of SLAM on the map; the simulator's truth is read by the scorer alone. 0.5 m/s at most, commands
    take hold after 0.1 s. Exit code 1: the car touched something, or something else is not as it must be.
    """
    from tools.drive_evaluation import evaluate_drives, table_of

    report = evaluate_drives(count, stops, boxes, seed, log.info)
    if as_json:
        print_json(report)
    else:
        for line in table_of(report):
            typer.echo(line)
    raise typer.Exit(ExitCode.OK if report["passed"] else ExitCode.FAILED)
