"""`mapfuse-robot evaluate relocalisation`: a kidnapped robot on a saved map."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import ConfigFile, Json, Seed, load_config, print_json
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def relocalisation(
    recording: Annotated[Path, typer.Argument(metavar="LOG", help="A recording that `replay` can map.")],
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help="The trajectory.tum `replay` wrote of it.")],
    map_part: Annotated[str, typer.Option(metavar="first-half|second-half", help="Scans the map is made of.")] = (
        "first-half"
    ),
    starts: Annotated[int, typer.Option(min=1, help="How many random starts.")] = 50,
    drive: Annotated[float, typer.Option(metavar="M", min=0.5, help="Driving allowed from each start.")] = 5.0,
    track: Annotated[float, typer.Option(metavar="M", min=0.0, help="Driving after it, tracked on the map.")] = 10.0,
    foreign_map: Annotated[
        Path | None,
        typer.Option(metavar="MAP", help="Search on this map of ANOTHER building instead: any place found is wrong."),
    ] = None,
    seed: Seed = 0,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Kidnap the robot: map one half of a log, start anywhere in the other half, and find the place on the map.

    Starts are drawn where the map knows what is seen (70 % of each metre's points fall on known cells), so "not found"
    is a miss. From each, odometry begins afresh. Found: within 0.15 m and 2 deg of the trajectory. Exit code 1: a place
    was found that is wrong.
    """
    from mapping.map_io import read_map
    from tools.driven_log import read_driven_log
    from tools.errors import UsageError
    from tools.relocalisation_evaluation import Kidnapping, MapPart, evaluate_relocalisation, map_of_part

    parts = [part.value for part in MapPart]
    if map_part not in parts:
        raise UsageError(f"--map-part {map_part!r}: expected {' or '.join(parts)}")
    config = load_config(config_file)
    settings = config.mapping_settings()
    driven = read_driven_log(recording, trajectory, config)
    part = MapPart(map_part)
    if foreign_map is not None:
        grid = read_map(foreign_map)
    else:
        grid = map_of_part(driven, part, settings.resolution_m, settings.lidar_model)
    report = evaluate_relocalisation(
        driven,
        part,
        grid,
        Kidnapping(starts, drive, track, seed),
        foreign=foreign_map is not None,
        on_progress=log.info,
    )
    if as_json:
        print_json(report)
    else:
        typer.echo(f"{'start s':>17} {'verdict':10} {'driven m':>8} {'error m':>8} {'deg':>6} {'search s':>8}")
        for row in report["rows"]:
            error = "       -      -" if row["error_m"] is None else f"{row['error_m']:8.3f} {row['error_deg']:6.2f}"
            where = f"{row['stamp_s']:17.3f} {row['verdict']:10} {row['driven_m']:8.2f}"
            typer.echo(f"{where} {error} {row['slowest_search_cpu_s']:8.3f}")
        width_m, height_m = report["map_m"]
        typer.echo(
            f"{report['starts']} starts on a map of {width_m:g} x {height_m:g} m: {report['found']} found,"
            f" {report['not_found']} not found, {report['wrong']} wrong"
        )
        if report["tracked_scans"]:
            typer.echo(
                f"tracked {report['tracked_scans']} scans: error {report['tracking_error_m_median']:.3f} m median,"
                f" {report['tracking_error_m_max']:.3f} m at most; {report['tracked_by_odometry']} more by odometry"
                f" alone; {report['tracks_lost']} tracks lost"
            )
    raise typer.Exit(ExitCode.FAILED if report["wrong"] else ExitCode.OK)
