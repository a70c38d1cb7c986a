"""`mapfuse-robot evaluate`: results against ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, print_json

app = typer.Typer(help="Score results against ground truth.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def scores() -> None:
    """Score results against ground truth."""


@app.command()
def slam(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help="A trajectory.tum that `replay` wrote.")],
    relations: Annotated[Path, typer.Argument(metavar="RELATIONS", help="True relative poses of the same log.")],
    as_json: Json = False,
) -> None:
    """Score a trajectory by true relative poses between scans, the relations metric (Kuemmerle et al. 2009).

    RELATIONS has one pair a line: stamp1 stamp2 dx dy dz roll pitch yaw. Exit code 3: some of its stamps are not in the
    trajectory, and the others are scored.
    """
    from dataclasses import asdict

    from mapping.relations import read_relations, relation_errors
    from mapping.trajectory import read_tum
    from tools.exit_codes import ExitCode

    errors = relation_errors(read_tum(trajectory), read_relations(relations))
    if as_json:
        print_json(asdict(errors))
    else:
        typer.echo(f"{errors.relations} relations, {errors.unmatched} without a pose")
        typer.echo(f"  translation  {errors.mean_m:.4f} +- {errors.std_m:.4f} m, at most {errors.max_m:.3f} m")
        typer.echo(
            f"  rotation     {errors.mean_deg:.3f} +- {errors.std_deg:.3f} deg, at most {errors.max_deg:.2f} deg"
        )
    raise typer.Exit(ExitCode.PARTIAL if errors.unmatched else ExitCode.OK)
