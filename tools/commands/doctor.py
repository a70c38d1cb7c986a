"""`mapfuse-robot doctor`: what is plugged in, is it healthy, what to fix."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, LidarPort, load_config, print_json
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.camera_check import CameraCheck
    from tools.lidar_check import LidarCheck


def doctor(
    lidar: LidarPort = None,
    camera: Annotated[
        bool, typer.Option("--camera", help="Look at the depth camera; without --lidar that is done anyway.")
    ] = False,
    depth: Annotated[
        str, typer.Option("--depth", metavar="NODE", help="Which one: auto, a node, or emulated:DRIVE.")
    ] = "auto",
    capture: Annotated[int, typer.Option(min=0, max=10_000, metavar="N", help="Look at so many frames.")] = 30,
    seconds: Annotated[float, typer.Option(min=0.5, max=600, metavar="S", help="Watch the lidar turn so long.")] = 3.0,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Say what is plugged in, whether it is well, and what to do where it is not.

    A lidar: its port and group, baud rate, model, health, motor, modes, and the measured speed and rate, each ok, warn
    or fail. A depth camera: where its calibration comes from, and what its frames are like. Exit code 4: there is
    none, or it cannot be used; 3: there is something to fix.
    """
    from dataclasses import asdict

    from tools.camera_check import check_camera
    from tools.lidar_check import State, check_lidar
    from tools.signals import stop_on_signals

    config = load_config(config_file)
    found: dict[str, dict[str, object]] = {}
    code = ExitCode.OK
    if lidar is not None:
        with stop_on_signals() as stop:
            of_lidar = check_lidar(lidar, config, seconds, stop)
        found["lidar"] = {**asdict(of_lidar), "state": of_lidar.state}
        code = {State.OK: ExitCode.OK, State.WARN: ExitCode.PARTIAL, State.FAIL: ExitCode.DEVICE}[of_lidar.state]
        if not as_json:
            _print_lidar(of_lidar)
    if lidar is None and not camera:
        typer.echo("looking at the depth camera; --lidar PORT checks the lidar", err=True)
    if camera or lidar is None:
        of_camera = check_camera(depth, config, capture)
        found["camera"] = asdict(of_camera)
        code = max(code, ExitCode.PARTIAL if of_camera.advice else ExitCode.OK)
        if not as_json:
            _print(of_camera)
    if as_json:
        print_json(found if len(found) > 1 else next(iter(found.values())))
    raise typer.Exit(code)


def _print_lidar(check: LidarCheck) -> None:
    typer.echo(f"{check.port}{'  (EMULATED: simulated data)' if check.simulated else ''}")
    for finding in check.findings:
        advice = f": {finding.advice}" if finding.advice else ""
        typer.echo(f"  {finding.state.value:4s}  {finding.what:6s}  {finding.text}{advice}")


def _print(check: CameraCheck) -> None:
    for node in check.nodes:
        speed = "" if node["usb_mbps"] is None else f", USB at {node['usb_mbps']:.0f} Mbit/s"
        typer.echo(f"{node['path']}: {node['model']} streams depth{speed}")
    for line in check.refused:
        typer.echo(f"not asked: {line}")
    label = "  (EMULATED: simulated data)" if check.simulated else ""
    typer.echo(f"{check.path}: {check.card}{label}")
    typer.echo(f"  firmware {check.firmware}, serial {check.serial}; {check.mode}")
    typer.echo(f"  intrinsics from {check.calibration}: focal length {check.focal_px:.1f} px; unit {check.unit_m:g} m")
    for note in check.calibration_notes:
        typer.echo(f"  {note}")
    if check.valid_share is not None:
        rate = "" if check.rate_hz is None else f", {check.rate_hz:.1f} a second"
        typer.echo(f"  {check.frames} frames{rate}, {check.valid_share:.1%} of the pixels measured")
    for line in check.advice:
        typer.echo(f"  to fix: {line}")
