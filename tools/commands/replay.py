"""`mapfuse-robot replay`: the flow of a live run, from a recording."""

from __future__ import annotations

import logging
from enum import Enum
from typing import Annotated

import typer

from tools.commands.options import (
    METRES_PER_COUNT,
    CellsPerMeter,
    ConfigFile,
    DepthUnit,
    Intrinsics,
    Json,
    MapFile,
    OutputFolder,
    RecordingPath,
    ResolutionM,
    Resume,
    load_config,
    print_json,
    refuse_folder_options,
)
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


class OdometrySource(str, Enum):
    """Where the poses of a replay come from."""

    kiss = "kiss"
    wheel = "wheel"
    recorded = "recorded"


def replay(
    recording: RecordingPath,
    output: OutputFolder = None,
    config_file: ConfigFile = None,
    resolution: ResolutionM = None,
    cells_per_meter: CellsPerMeter = None,
    odometry: Annotated[
        OdometrySource | None,
        typer.Option(
            help="Poses from scan matching (kiss), from the recorded wheels alone, or as recorded in /tf or beside the"
            " images. [default: kiss]"
        ),
    ] = None,
    intrinsics: Intrinsics = None,
    depth_unit: DepthUnit = None,
    loop_closure: Annotated[
        bool | None, typer.Option("--loop-closure/--no-loop-closure", help="Look for places seen before.")
    ] = None,
    refine: Annotated[
        bool | None, typer.Option("--refine/--no-refine", help="Match all keyframes with each other at the end.")
    ] = None,
    scan_every: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Map only every N-th scan (the thesis's scan rate).")
    ] = None,
    map_file: MapFile = None,
    resume: Resume = None,
    save_state: Annotated[
        bool, typer.Option("--save-state", help="Also write slam_state.npz, which --resume goes on from.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Map a recording: the same flow as `run`, as fast as it goes.

    Writes map.yaml/.pgm/.npz/.png, pose_graph.png, trajectory.tum and report.json; with a lidar and a depth camera also
    depth_map.* and both_map.*. A recording of `run` or `record` is mapped with the configuration that was recorded with
    it, unless --config is given. Exit code 3: the recording is damaged, and was mapped as far as it goes; or tracking
    was lost and a piece of the drive has no place in the map; or the car was not found on the map of --map.
    """
    from drivers.recording_reader import open_recording
    from mapping.map_io import read_map
    from mapping.slam_state import read_state
    from tools.replay_run import recorded_config, replay_recording
    from tools.result_folder import MAPPED, check_result_folder
    from tools.results import is_placed

    check_result_folder(output, MAPPED, [path for path in (map_file, resume) if path is not None])
    refuse_folder_options(recording, intrinsics, depth_unit)
    if map_file is not None:
        read_map(map_file)  # a bad file must not cost the time of a replay
    with open_recording(recording, intrinsics=intrinsics, depth_unit_m=depth_unit or METRES_PER_COUNT) as opened:
        config = load_config(config_file) if config_file else recorded_config(opened)
        config = config.with_resolution(resolution, cells_per_meter).with_odometry(odometry.value if odometry else None)
        config = config.with_slam(loop_closure=loop_closure, refine=refine, scan_every=scan_every)
        report = replay_recording(
            opened,
            config,
            output,
            on_progress=log.info,
            resume=read_state(resume) if resume else None,
            save_state=save_state,
            map_file=map_file,
        )
    if as_json:
        print_json(report)
    raise typer.Exit(
        ExitCode.PARTIAL if report["truncated"] or report["problems"] or not is_placed(report) else ExitCode.OK
    )
