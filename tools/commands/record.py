"""`mapfuse-robot record`: the sensors to a file, without mapping."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import ConfigFile, DepthPort, Json, LidarPort, load_config, print_json, require_sensor
from tools.exit_codes import ExitCode


def record(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The MCAP file to write.")],
    lidar: LidarPort = None,
    depth: DepthPort = None,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Record until Ctrl-C (or SIGTERM): a lidar's raw bytes with their times and scans, a camera's depth images.

    Exit code 4: the lidar is missing, silent, busy or faulty, or was lost on the way (all that came is saved); 3: the
    recording has gaps.
    """
    from tools.lidar_session import record_session, session_is_whole
    from tools.results import check_new_file
    from tools.signals import stop_on_signals

    require_sensor(lidar, depth)
    config = load_config(config_file)
    check_new_file(output)
    with stop_on_signals() as stop:
        report, fault = record_session(lidar, config, output, stop, camera_port=depth)
    if as_json:
        print_json(report)
    if fault is not None:
        raise fault
    raise typer.Exit(ExitCode.OK if session_is_whole(report) else ExitCode.PARTIAL)
