"""`mapfuse-robot record`: the sensor to a file, without mapping."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import ConfigFile, Json, LidarPort, load_config, print_json
from tools.exit_codes import ExitCode


def record(
    lidar: LidarPort,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The MCAP file to write.")],
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Record the lidar until Ctrl-C (or SIGTERM): raw bytes with their times, and scans that other tools read.

    Exit code 4: the lidar is missing, silent, busy or faulty, or was lost on the way (all that came is saved); 3: the
    recording has gaps.
    """
    from tools.lidar_session import record_session, session_is_whole
    from tools.results import check_new_file
    from tools.signals import stop_on_signals

    config = load_config(config_file)
    check_new_file(output)
    with stop_on_signals() as stop:
        report, fault = record_session(lidar, config, output, stop)
    if as_json:
        print_json(report)
    if fault is not None:
        raise fault
    raise typer.Exit(ExitCode.OK if session_is_whole(report) else ExitCode.PARTIAL)
