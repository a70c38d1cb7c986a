"""`mapfuse-robot plan`: a path on a map."""

from __future__ import annotations

import time
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, finite, load_config, print_json
from tools.errors import UsageError
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.results import Report


class PlannerName(str, Enum):
    """Planners on offer."""

    car = "car"
    rrt = "rrt"
    rrt_connect = "rrt_connect"
    rrt_star = "rrt_star"
    informed_rrt_star = "informed_rrt_star"
    bit_star = "bit_star"


class UnknownPolicy(str, Enum):
    """What to do about space that was not seen."""

    forbidden = "forbidden"
    costly = "costly"
    free = "free"


def plan(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="The map: .yaml or .npz.")],
    start: Annotated[
        tuple[float, float, float],
        typer.Option(
            metavar="X Y YAW",
            help="Where the car stands: its rear axle's middle in the map frame, in m, and where it points, in rad"
            " (0 along x, 1.57 along y).",
        ),
    ],
    goal: Annotated[tuple[float, float, float], typer.Option(metavar="X Y YAW", help="Where it is to stand.")],
    planner: Annotated[
        PlannerName | None,
        typer.Option(
            help="How to search. car: along the map's free ways, then shortened; the others are OMPL's alone, for"
            " comparison.  [default: car]"
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=0.2,
            max=100.0,
            callback=finite,
            help="Tightest circle of the rear axle; what the steering can do, and a third more to correct with."
            "  [default: 0.576, a QCar]",
        ),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            metavar="M", min=0.0, max=10.0, callback=finite, help="Room to keep around the body.  [default: 0.01]"
        ),
    ] = None,
    unknown: Annotated[
        UnknownPolicy | None,
        typer.Option(
            help="Space that was not seen: keep off (specks smaller than the car excepted), go there for want of a"
            " better way, or like anywhere else.  [default: forbidden]"
        ),
    ] = None,
    forward_only: Annotated[bool | None, typer.Option("--forward-only", help="Never drive backwards.")] = None,
    reverse_cost: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            min=1.0,
            max=100.0,
            callback=finite,
            help="A metre backwards counts as so many.  [default: 1.5]",
        ),
    ] = None,
    goal_tolerance: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="M RAD",
            help="The car may end so far from the goal and so much turned, where it does not fit.  [default: 0 0]",
        ),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.0,
            max=3600.0,
            callback=finite,
            help="Time for finding a path and making it shorter; without --seed.  [default: 0.3]",
        ),
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.0,
            max=3600.0,
            callback=finite,
            help="The longest that a path is looked for, come what may.  [default: 10]",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Any number, to get the same path each time: the budget is then a number of iterations, not a time."
            "  [default: none]",
        ),
    ] = None,
    iterations: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="The budget with --seed.  [default: 200]")
    ] = None,
    config_file: ConfigFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Also leave here: plan.png, a picture; plan.json; plan.mcap, the map and the path for ROS 2 tools.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Plan a path that a car can drive, forwards and backwards, from one pose to another on a map.

    The car is a Quanser QCar, or the one in the section `planning` of a configuration (see `config show`), footprint
    included; options come before the file. Every centimetre of the path is checked with the car's outline. Exit code 1:
    no path; the reason, and a pose nearby that would do where there is one, are printed all the same.
    """
    from planning.worker import PlanningWorker
    from tools.path_planning import plan_on_map

    if budget is not None and seed is not None:
        raise UsageError("--budget: with --seed a plan is to be the same on every computer: give --iterations instead")
    if iterations is not None and seed is None:
        raise UsageError("--iterations: only with --seed; without it the budget is a time (--budget)")
    chosen = {
        "planner": planner and planner.value,
        "turning_radius_m": radius,
        "margin_m": margin,
        "unknown": unknown and unknown.value,
        "forward_only": forward_only,
        "reverse_cost": reverse_cost,
        "goal_tolerance_m": goal_tolerance and goal_tolerance[0],
        "goal_tolerance_rad": goal_tolerance and goal_tolerance[1],
        "budget_s": budget,
        "iterations": iterations,
        "time_limit_s": time_limit,
    }
    section = load_config(config_file).with_planning(chosen).planning
    with PlanningWorker(clock=time.monotonic) as worker:
        report = plan_on_map(worker, map_file, start, goal, section, seed=seed, output=output)
    if as_json:
        print_json(report)
    else:
        _tell(report)
        if output is not None:
            typer.echo(f"  picture       {output / 'plan.png'}")
    raise typer.Exit(ExitCode.OK if report["solved"] else ExitCode.FAILED)


def _tell(report: Report) -> None:
    """Print the path in short, or on stderr why there is none and what would do."""
    if report["solved"]:
        clearance = report["min_clearance_m"]
        typer.echo(
            f"solved: {report['length_m']:.2f} m, {len(report['path'])} poses, in {report['seconds']:.2f} s,"
            f" the first path after {report['first_path_s']:.3f} s"
        )
        typer.echo(f"  nearest wall  {'none' if clearance is None else f'{clearance:.3f} m'} from the car's body")
        typer.echo(f"  gear changes  {len(report['cusps'])}")
        return
    typer.echo(f"{report['error']}: {report['reason']}", err=True)
    if report["advice"]:
        end = "--start" if report["error"].startswith("START") else "--goal"
        pose = " ".join(f"{value:.4f}" for value in report["advice"])
        typer.echo(f"  the nearest pose that would do: {end} {pose}", err=True)
