"""`mapfuse-robot demo`: the main job without any hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, print_json
from tools.exit_codes import ExitCode


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results; emptied of a former demo.")
    ] = Path("runs/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensor noise and of the random samples.")] = 0,
    explore: Annotated[
        bool, typer.Option("--explore", help="The two cars drive themselves while they map: run --goal, without --map.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Two emulated cars map a building, their maps become one, and one drives on it to where the other one started.

    Takes about three minutes. All data are simulated; everything above the serial ports is what runs on the cars.
    Leaves demo.png and demo.json, scored against the truth, and each car's results. Exit code 3: the maps were not
    fused; 1: no path was found, the car did not arrive or touched something, or a replay differs from its live run.
    """
    from tools.demo_mission import exit_code_of, run_demo
    from tools.demo_table import table

    report = run_demo(output, seed, explore=explore)
    if report is None:
        raise typer.Exit(ExitCode.CUT_OFF)
    if as_json:
        print_json(report)
    else:
        typer.echo(table(output, report))
    raise typer.Exit(exit_code_of(report))
