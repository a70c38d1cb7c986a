"""`mapfuse-robot run`: the whole flow, live on the vehicle."""

from __future__ import annotations

import logging
import os
from typing import Annotated

import typer

from tools.commands.options import (
    CellsPerMeter,
    ConfigFile,
    DepthPort,
    Json,
    LidarPort,
    MapFile,
    OutputFolder,
    ResolutionM,
    Resume,
    load_config,
    print_json,
    require_sensor,
)
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def run(
    lidar: LidarPort = None,
    depth: DepthPort = None,
    output: OutputFolder = None,
    config_file: ConfigFile = None,
    resolution: ResolutionM = None,
    cells_per_meter: CellsPerMeter = None,
    record: Annotated[bool, typer.Option("--record/--no-record", help="Record every byte of the sensor.")] = True,
    map_file: MapFile = None,
    resume: Resume = None,
    as_json: Json = False,
) -> None:
    """Map live until Ctrl-C (or SIGTERM), which saves everything.

    Writes map.yaml/.pgm/.npz/.png, pose_graph.png, trajectory.tum, report.json, recording.mcap and slam_state.npz, from
    which --resume goes on; then refines the map and writes it again (Ctrl-C once more leaves that out). Exit code 4:
    the lidar is missing, silent, busy or faulty, or was lost on the way (all that came is saved); 3: scans were
    dropped, the recording has gaps, a piece of the drive has no place in the map, the car was not found on the map of
    --map, or the camera beside a lidar was lost. With both, depth_map.* and both_map.* are written too; a camera alone
    makes the map.
    """
    from mapping.map_io import read_map
    from mapping.slam_state import read_state
    from tools.lidar_session import SensorPorts, run_session, session_is_whole
    from tools.localisation import FoundOnMap
    from tools.result_folder import MAPPED, check_result_folder, new_results
    from tools.results import is_placed
    from tools.service_notice import service_notices
    from tools.signals import stop_on_signals

    require_sensor(lidar, depth)
    config = load_config(config_file, resolution, cells_per_meter)
    check_result_folder(output, MAPPED, [path for path in (map_file, resume) if path is not None], records=record)
    earlier = read_state(resume) if resume else None
    if map_file is not None:
        read_map(map_file)  # before the lidar starts: a bad file must not cost a drive
    with stop_on_signals() as stop:
        report, fault = run_session(
            SensorPorts(lidar, depth),
            config,
            lambda: new_results(output, MAPPED),
            stop,
            record=record,
            resume=earlier,
            parts=[*([] if map_file is None else [FoundOnMap(map_file)]), *service_notices(os.environ)],
        )
    if as_json:
        print_json(report)
    if fault is not None:
        raise fault
    is_whole = session_is_whole(report) and is_placed(report)
    raise typer.Exit(ExitCode.OK if is_whole else ExitCode.PARTIAL)
