"""`mapfuse-robot evaluate plans`: a planner on a set of problems."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from tools.commands.options import Json, Seed, TimeLimit, TurningRadius, finite, print_json
from tools.errors import ToolError, UsageError
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.plan_trials import Trial
    from tools.results import Report

log = logging.getLogger(__name__)
_FAULTS = ("colliding", "too_curved", "wrong_gears", "gaps", "ends_off")


def plans(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="PROBLEMS.json",
            help="{map: [{start, goal, ref}]}, <map>.yaml beside it; with --random or --blocked also maps and folders.",
        ),
    ],
    random: Annotated[
        int,
        typer.Option("--random", min=0, metavar="N", help="Instead: N random problems over the maps, 6 m and more."),
    ] = 0,
    blocked: Annotated[
        bool, typer.Option("--blocked", help="Instead: 30 problems without a solution on each map.")
    ] = False,
    budget: Annotated[
        float, typer.Option(metavar="S", min=0.0, max=60.0, callback=finite, help="To shorten each random plan.")
    ] = 0.05,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time, for --random.")] = 1,
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
    from tools.plan_evaluation import evaluate_plans
    from tools.plan_trials import Trial

    unknown = UnknownSpace.free if unknown_free else UnknownSpace.forbidden
    if random or blocked:
        trial = Trial(
            Vehicle(turning_radius_m=radius), unknown, PlanSettings(budget_s=budget, time_limit_s=time_limit), seed
        )
        _try(sources, trial, random, jobs, as_json)
    if len(sources) > 1:
        raise UsageError("several files: only with --random or --blocked")
    problems = sources[0]
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


def _try(sources: list[Path], trial: Trial, count: int, jobs: int, as_json: bool) -> NoReturn:
    """Run the random problems, or where count is 0 those without a solution, and end the command."""
    from tools.blocked_plans import try_blocked_plans
    from tools.maps_at_hand import map_files
    from tools.plan_trials import try_random_plans

    files = map_files(sources)
    report = (
        try_random_plans(files, count, trial, jobs, log.info) if count else try_blocked_plans(files, trial, log.info)
    )
    if as_json:
        print_json(report)
    elif count:
        typer.echo(f"{'map':<28} solved     paths with faults   first path ms, median p95 max   why not")
        for name, row in [*report["maps"].items(), ("all", report.get("all"))]:
            if row:
                typer.echo(_random_line(Path(name).stem, row))
    else:
        for row in report["rows"]:
            typer.echo(
                f"{Path(row['map']).stem}: {row['made']}: {row['error']} in {1000.0 * row['seconds']:.1f} ms"
                f"{'' if row['right'] else ' WRONG, expected ' + row['expected']}"
            )
        typer.echo(
            f"{report['right']}/{report['problems']} right, {report['late']} later than 50 ms, {report['seconds']}"
        )
    for name in report["narrow"]:
        typer.echo(f"{name}: left out: no two poses of the car 6 m apart are joined", err=True)
    rows = [report["all"]] if report.get("all") else []
    if any(row[kind] for row in rows for kind in _FAULTS):
        raise ToolError("some of the paths have faults: see them with --json, 'failures'")
    whole = report["right"] == report["problems"] if not count else all(r["solved"] == r["problems"] for r in rows)
    raise typer.Exit(ExitCode.OK if whole else ExitCode.PARTIAL)


def _random_line(name: str, row: Report) -> str:
    """Return what came of random problems on one map in one line; a path may have several faults."""
    faults = [f"{kind.replace('_', ' ')} {row[kind]}" for kind in _FAULTS if row[kind]]
    first = row["first_ms"]
    times = f"{first['median']:14.1f} {first['p95']:8.1f} {first['max']:8.1f}" if first else f"{'-':>14}"
    errors = ", ".join(f"{error} {count}" for error, count in row["errors"].items())
    return f"{name:<28} {row['solved']:>4}/{row['problems']:<5} {', '.join(faults) or 'none':<18} {times}   {errors}"
