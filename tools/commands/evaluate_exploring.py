"""`mapfuse-robot evaluate exploring`: a simulated car drives on the map that it is making."""

from __future__ import annotations

import logging

import typer

from tools.commands.options import Json, Seed, print_json
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def exploring(seed: Seed = 0, as_json: Json = False) -> None:
    """Drive a simulated car to goals without a saved map, as `run --goal` without --map does.

    In three parts of buildings, three goals each: the two wings that the cars of the demo map, and rooms of the office.
    On a simulated clock, by the bytes of lidar and vehicle link; about two minutes of computing. Exit code 1: a car did
    not arrive within 0.10 m and 15 deg, or touched a wall.
    """
    from tools.exploring_evaluation import evaluate_exploring, line_of

    report = evaluate_exploring(seed, log.info)
    if as_json:
        print_json(report)
    else:
        for row in report["rows"]:
            typer.echo(line_of(row))
    raise typer.Exit(ExitCode.OK if report["passed"] else ExitCode.FAILED)
