"""`mapfuse-robot plan`: a path on a map."""

from __future__ import annotations

from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, TimeLimit, TurningRadius, finite, print_json
from tools.exit_codes import ExitCode


class PlannerName(str, Enum):
    """OMPL's planners on offer."""

    rrt = "rrt"
    rrt_connect = "rrt_connect"


class UnknownPolicy(str, Enum):
    """What to do about space that was not seen."""

    forbidden = "forbidden"
    free = "free"


def plan(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="The map: .yaml or .npz.")],
    start: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y YAW", help="Pose of the rear axle in the map frame: m, m, rad."),
    ],
    goal: Annotated[tuple[float, float, float], typer.Option(metavar="X Y YAW", help="Where it is to stand.")],
    planner: Annotated[PlannerName, typer.Option(help="OMPL planner.")] = PlannerName.rrt_connect,
    radius: TurningRadius = 0.55,
    margin: Annotated[
        float, typer.Option(metavar="M", min=0.0, max=10.0, callback=finite, help="Room to keep around the car's body.")
    ] = 0.01,
    unknown: Annotated[
        UnknownPolicy, typer.Option(help="Keep off unseen space (specks smaller than the car excepted), or not.")
    ] = UnknownPolicy.forbidden,
    time_limit: TimeLimit = 10.0,
    seed: Seed = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Also leave plan.json and plan.png here.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Plan a path that a car can drive, in Reeds-Shepp curves, forwards and backwards.

    Every pose is checked with the rectangle of the car (a Quanser QCar). Exit code 1: no path; the reason, and a pose
    nearby that would do where there is one, are printed all the same.
    """
    from planning.costmap import UnknownSpace
    from planning.plan import PlanSettings
    from planning.planner import Planner
    from planning.vehicle import Vehicle
    from tools.path_planning import plan_on_map

    settings = PlanSettings(Planner(planner.value), UnknownSpace(unknown.value), time_limit)
    vehicle = Vehicle(turning_radius_m=radius, margin_m=margin)
    report = plan_on_map(map_file, start, goal, vehicle, settings, seed, output)
    if as_json:
        print_json(report)
    elif report["solved"]:
        clearance = report["min_clearance_m"]
        typer.echo(f"solved: {report['length_m']:.2f} m, {len(report['path'])} poses, in {report['seconds']:.2f} s")
        typer.echo(f"  nearest wall  {'none' if clearance is None else f'{clearance:.3f} m'} from the car's body")
        typer.echo(f"  gear changes  {sum(a != b for a, b in pairwise(report['direction']))}")
    else:
        typer.echo(f"{report['error']}: {report['reason']}", err=True)
        if report["advice"]:
            typer.echo(
                "  a pose nearby that would do: " + " ".join(f"{value:.3f}" for value in report["advice"]), err=True
            )
    raise typer.Exit(ExitCode.OK if report["solved"] else ExitCode.FAILED)
