"""`mapfuse-robot evaluate plans`: a planner on a set of problems."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, TimeLimit, TurningRadius, print_json
from tools.errors import ToolError
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def plans(
    problems: Annotated[
        Path, typer.Argument(metavar="PROBLEMS.json", help="{map: [{start, goal, ref}]}, with <map>.yaml beside it.")
    ],
    radius: TurningRadius = 0.576,
    time_limit: TimeLimit = 10.0,
    unknown_free: Annotated[bool, typer.Option("--unknown-free", help="Let paths cross unseen space.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Plan every problem with three planners (car, RRT, RRT-Connect); check each path again by another method.

    Exit code 3: some problems are unsolved. Exit code 1: a path collides.
    """
    from planning.costmap import UnknownSpace
    from planning.plan import Planner, PlanSettings
    from planning.vehicle import Vehicle
    from tools.plan_problems import evaluate_plans

    unknown = UnknownSpace.free if unknown_free else UnknownSpace.forbidden
    reports = []
    for planner in (Planner.car, Planner.rrt, Planner.rrt_connect):
        settings = PlanSettings(planner, time_limit_s=time_limit)
        reports.append(evaluate_plans(problems, Vehicle(turning_radius_m=radius), unknown, settings, seed, log.info))
    maps = [(report["planner"], name, row) for report in reports for name, row in report["maps"].items()]
    if as_json:
        print_json({"planners": reports})
    else:
        typer.echo("planner      map          solved  colliding  s median  s p95   length/ref median, p95")
        for planner_name, name, row in maps:
            typer.echo(
                f"{planner_name:12} {name:12} {row['solved']:2}/{row['problems']:2}   {row['colliding_paths']:9}"
                f"  {row['seconds_median']:8.3f}  {row['seconds_p95']:6.3f}"
                f"  {row['length_over_ref_median']}, {row['length_over_ref_p95']}"
            )
    colliding = sum(row["colliding_paths"] for _, _, row in maps)
    if colliding:
        raise ToolError(f"{colliding} of the paths collide: see 'colliding'")
    solved = all(row["solved"] == row["problems"] for _, _, row in maps)
    raise typer.Exit(ExitCode.OK if solved else ExitCode.PARTIAL)
