"""`mapfuse-robot evaluate drives`: the closed loop in the simulator."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, print_json
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def drives(
    count: Annotated[int, typer.Option("-n", "--drives", min=0, help="Drives to a goal.")] = 20,
    stops: Annotated[int, typer.Option(min=0, help="Stops on the way, of each kind.")] = 20,
    boxes: Annotated[int, typer.Option(min=0, help="Drives on whose path a box is put.")] = 20,
    within: Annotated[
        float, typer.Option(min=0.1, help="Ends of the drives lie so near, in m, to where the map was made.")
    ] = math.inf,
    jobs: Annotated[int, typer.Option(min=1, help="Processes that drive at once.")] = 1,
    live: Annotated[
        int,
        typer.Option(min=0, metavar="N", help="Instead: so many in real time of each kind, driven by `run` itself."),
    ] = 0,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drive a simulated car by its emulated lidar's bytes: map the office, then plan, drive, arrive, and stop.

    Commands go as MAVLink bytes to an emulated rover, which is the car. The pose is that of SLAM on the map; the
    simulator's truth is read by the scorer alone. 0.5 m/s at most, commands take hold after 0.1 s. Stops of each kind:
    old poses, old scans, an emergency stop, a silent vehicle, our process killed, a cut link, a vehicle that hears
    nothing. --live: `run` drives an emulated car over a pseudo-terminal and UDP; it arrives, or is ended by Ctrl-C, an
    emergency stop, SIGKILL, a silent lidar, one that sees nothing (scans without a pose) or a cut link; half a minute
    each. Exit code 1: the car touched something, or something else is not as it must be.
    """
    from tools.drive_evaluation import DrivesWanted, evaluate_drives
    from tools.drive_report import table_of
    from tools.live_drive_trials import evaluate_live, table_of_live

    if live:
        with TemporaryDirectory() as folder:
            report = evaluate_live(live, seed, Path(folder), log.info)
        lines = table_of_live(report)
    else:
        report = evaluate_drives(DrivesWanted(count, stops, boxes, seed, within, jobs), log.info)
        lines = table_of(report)
    if as_json:
        print_json(report)
    else:
        for line in lines:
            typer.echo(line)
    raise typer.Exit(ExitCode.OK if report["passed"] else ExitCode.FAILED)
