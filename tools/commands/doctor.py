"""`mapfuse-robot doctor`: what is plugged in, is it healthy, what to fix."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, load_config, print_json
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.camera_check import CameraCheck


def doctor(
    _camera: Annotated[
        bool, typer.Option("--camera", help="Look at the depth camera; so far all that there is to look at.")
    ] = True,
    depth: Annotated[
        str, typer.Option("--depth", metavar="NODE", help="Which one: auto, a node, or emulated:DRIVE.")
    ] = "auto",
    capture: Annotated[int, typer.Option(min=0, max=10_000, metavar="N", help="Look at so many frames.")] = 30,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Say which depth camera is plugged in, where its calibration comes from, and what its frames are like.

    That is all it can look at; a lidar says what is wrong with it when `run` or `record` starts it.
    Exit code 4: there is none, or it cannot be used, with the reason in one line; 3: there is something to fix.
    """
    from dataclasses import asdict

    from tools.camera_check import check_camera

    check = check_camera(depth, load_config(config_file), capture)
    if as_json:
        print_json(asdict(check))
    else:
        _print(check)
    raise typer.Exit(ExitCode.PARTIAL if check.advice else ExitCode.OK)


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
