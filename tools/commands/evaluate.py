"""`mapfuse-robot evaluate`: results against ground truth."""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, print_json

app = typer.Typer(help="Score results against ground truth.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def scores() -> None:
    """Score results against ground truth."""


class DeltaUnit(str, Enum):
    """What the interval of the relative pose error is measured in."""

    m = "m"
    s = "s"


@app.command()
def slam(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="TRAJECTORY... TRUTH", help="One or more trajectory.tum of `replay`; last, the truth."),
    ],
    delta: Annotated[float, typer.Option(help="Interval of the relative pose error (RPE).")] = 1.0,
    delta_unit: Annotated[DeltaUnit, typer.Option(help="Its unit: metres driven or seconds.")] = DeltaUnit.m,
    as_json: Json = False,
) -> None:
    """Errors of trajectories against ground truth: one row each.

    TRUTH is told by its content. A file of true relative poses (stamp1 stamp2 dx dy dz roll pitch yaw) gives the
    relations metric (Kuemmerle et al. 2009): how well true relative poses between scans are kept, also of those under
    10 s alone. A true trajectory of base_link in TUM text gives ATE after the best planar alignment, and RPE. Exit code
    3: some relations have stamps that are not in the trajectory, and the others are scored.
    """
    from tools.errors import UsageError
    from tools.exit_codes import ExitCode
    from tools.slam_evaluation import Interval, is_partial, score_trajectories, table_of

    if len(files) < 2:
        raise UsageError(f"{files[0]}: name one or more trajectories and, last, the truth")
    if not (math.isfinite(delta) and delta > 0.0):
        raise UsageError(f"--delta {delta}: must be a positive number")
    *trajectories, truth = files
    rows = score_trajectories(trajectories, truth, Interval(delta, delta_unit.value))
    if as_json:
        print_json(rows[0] if len(rows) == 1 else {"results": rows})
    else:
        for line in table_of(rows):
            typer.echo(line)
    raise typer.Exit(ExitCode.PARTIAL if any(map(is_partial, rows)) else ExitCode.OK)
