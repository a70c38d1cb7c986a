"""`mapfuse-robot run`: the whole flow, live on the vehicle."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

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
from tools.errors import UsageError
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.drive_goals import Pose
    from tools.live_journey import JourneyWanted

log = logging.getLogger(__name__)

_GOAL = "--goal"


class WithGoals(TyperCommand):
    """A command whose --goal takes three words each time it is given, for which typer has no type."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join the three words behind each --goal before the parser sees them."""
        words = iter(args)
        joined = [f"{_GOAL}={' '.join(next(words, '') for _ in range(3))}" if word == _GOAL else word for word in words]
        return super().parse_args(ctx, joined)


def run(
    lidar: LidarPort = None,
    depth: DepthPort = None,
    output: OutputFolder = None,
    config_file: ConfigFile = None,
    resolution: ResolutionM = None,
    cells_per_meter: CellsPerMeter = None,
    record: Annotated[bool, typer.Option("--record/--no-record", help="Record every byte of the sensor.")] = True,
    share_every: Annotated[
        float | None,
        typer.Option(
            "--share-every",
            metavar="S",
            min=0.2,
            max=3600.0,
            help="Write map.npz so often while mapping, for `fuse --watch`.  [default: at the end only]",
        ),
    ] = None,
    map_file: MapFile = None,
    goal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X Y YAW",
            help="Drive there on the map of --map, in m and rad (0 along x); may be repeated: one after the other."
            " Without --map on the map that is being made, which begins where the car stands, x ahead.",
        ),
    ] = None,
    start: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y YAW",
            help="Where on that map about the car stands, to 0.3 m; without it the car looks for its place.",
        ),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="The car: udp:HOST:PORT, serial:PATH[:BAUD] or tcp:HOST:PORT of a MAVLink vehicle, qcar, or none (what"
            " would be commanded is told and recorded). Without --goal it is told where it is, and not driven."
            "  [default: none]",
        ),
    ] = None,
    resume: Resume = None,
    as_json: Json = False,
) -> None:
    """Map live until Ctrl-C (or SIGTERM), which saves everything; with --goal, drive there and end.

    Writes map.yaml/.pgm/.npz/.png, pose_graph.png, trajectory.tum, report.json, recording.mcap and slam_state.npz, from
    which --resume goes on; then refines the map and writes it again (Ctrl-C once more leaves that out). A car that is
    driven stands at Ctrl-C, before anything is saved; Enter, Ctrl-Z and SIGUSR1 are its emergency stop, until a new
    start (docs/driving.md). Exit code 4: the lidar is missing, silent, busy or faulty, or was lost on the way (all that
    came is saved), or the vehicle; 3: a goal was not reached, scans were dropped, the recording has gaps, a piece of
    the drive has no place in the map, the car was not found on the map of --map, or the camera beside a lidar was lost.
    With both, depth_map.* and both_map.* are written too; a camera alone makes the map.
    """
    from mapping.map_io import read_map
    from mapping.slam_state import read_state
    from tools.clock import RunClock
    from tools.lidar_session import SensorPorts, run_session, session_is_whole
    from tools.live_journey import journey, without_wheels
    from tools.map_sharing import SharedMap
    from tools.result_folder import MAPPED, check_result_folder, new_results
    from tools.results import is_placed
    from tools.service_notice import service_notices
    from tools.signals import stop_on_signals

    require_sensor(lidar, depth)
    config = load_config(config_file, resolution, cells_per_meter)
    wanted = wanted_of(lidar=lidar, map_file=map_file, goal=goal, start=start, vehicle=vehicle, resume=resume)
    if wanted.uses_vehicle:
        config = without_wheels(config)
    check_result_folder(output, MAPPED, [path for path in (map_file, resume) if path is not None], records=record)
    earlier = read_state(resume) if resume else None
    if map_file is not None:
        read_map(map_file)  # before the lidar starts: a bad file must not cost a drive
    clock = RunClock()
    shared = [] if share_every is None else [SharedMap(share_every)]
    with stop_on_signals() as stop, journey(wanted, config, clock) as way:
        status = None if way.drive is None else way.drive.status
        report, fault = run_session(
            SensorPorts(lidar, depth),
            config,
            lambda: new_results(output, MAPPED),
            stop,
            record=record,
            resume=earlier,
            parts=[*way.parts, *shared, *service_notices(os.environ, status)],
            clock=clock,
        )
    if as_json:
        print_json(report)
    if fault is not None:
        raise fault
    is_whole = way.conclude() and session_is_whole(report) and is_placed(report)
    raise typer.Exit(ExitCode.OK if is_whole else ExitCode.PARTIAL)


def wanted_of(
    *,
    lidar: str | None,
    map_file: Path | None,
    goal: Sequence[str] | None,
    start: Pose | None,
    vehicle: str | None,
    resume: Path | None,
) -> JourneyWanted:
    """Return where these options drive to; raises UsageError for what makes no sense together."""
    from tools.live_journey import JourneyWanted

    goals = tuple(_pose_of(words) for words in goal or ())
    return JourneyWanted(map_file, goals, start, vehicle, has_lidar=lidar is not None, resumes=resume is not None)


def _pose_of(words: str) -> Pose:
    """Return the pose of a --goal; raises UsageError."""
    try:
        x_m, y_m, yaw_rad = (float(word) for word in words.replace(",", " ").split())
    except ValueError as error:
        raise UsageError(f"--goal {words.strip()}: expected three numbers: x and y in m, yaw in rad") from error
    return x_m, y_m, yaw_rad
