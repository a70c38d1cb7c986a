"""`mapfuse-robot replay`: the flow of a live run, from a recording."""

from __future__ import annotations

import logging
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import (
    CellsPerMeter,
    ConfigFile,
    Json,
    OutputFolder,
    ResolutionM,
    load_config,
    print_json,
)
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


class OdometrySource(str, Enum):
    """Where the poses of a replay come from."""

    kiss = "kiss"
    wheel = "wheel"


def replay(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="An MCAP or .db3 file, the folder of a ROS 2 bag, a CARMEN or tinySLAM log."
        ),
    ],
    output: OutputFolder = None,
    config_file: ConfigFile = None,
    resolution: ResolutionM = None,
    cells_per_meter: CellsPerMeter = None,
    odometry: Annotated[
        OdometrySource | None,
        typer.Option(help="Poses from scan matching (kiss), or from the recorded wheels alone. [default: kiss]"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Map a recording: the same flow as `run`, as fast as it goes.

    Writes map.yaml/.pgm/.npz/.png, trajectory.tum and report.json. A recording of `run` or `record` is mapped with the
    configuration that was recorded with it, unless --config is given. Exit code 3: the recording is damaged, and was
    mapped as far as it goes.
    """
    from drivers.recording_reader import open_recording
    from tools.replay_run import recorded_config, replay_recording
    from tools.results import check_run_folder

    check_run_folder(output)
    with open_recording(recording) as opened:
        config = load_config(config_file) if config_file else recorded_config(opened)
        config = config.with_resolution(resolution, cells_per_meter).with_odometry(odometry.value if odometry else None)
        report = replay_recording(opened, config, output, on_progress=log.info)
    if as_json:
        print_json(report)
    raise typer.Exit(ExitCode.PARTIAL if report["truncated"] or report["problems"] else ExitCode.OK)
