"""`mapfuse-robot evaluate camera`: maps of a depth camera fused with maps of a lidar."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import ConfigFile, Json, load_config, print_json
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def camera(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for maps, picture and report.")],
    seeds: Annotated[str, typer.Option(metavar="N|FIRST-LAST", help="Simulated buildings.")] = "0-19",
    size: Annotated[str, typer.Option(metavar="WxH", help="Of the camera's image in pixels.")] = "848x480",
    fps: Annotated[float, typer.Option(min=1.0, max=90.0, help="Images a second.")] = 6.0,
    wheels: Annotated[bool, typer.Option(help="The camera's car has wheel odometry.")] = True,
    jobs: Annotated[int, typer.Option(min=1, max=64, help="Processes at once.")] = 2,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Fuse camera maps with lidar maps of the same and of other simulated buildings (thesis section 5.6).

    Each seed is another building, driven and mapped by a car with a lidar and by one with a depth camera whose ranges
    are 2 % too long and whose mount is 1 deg off. Writes the maps, pairs.png and report.json. Exit code 1: a wrong pair
    was accepted, or a true one at a wrong place; 3: some true pairs were refused.
    """
    import json

    from tools.camera_evaluation import evaluate_camera, table_of
    from tools.errors import UsageError
    from tools.mapped_drives import CameraSetup
    from tools.results import check_run_folder, new_run_folder, writing_to
    from tools.simulated_wheels import WheelNoise

    numbers = _numbers(seeds, "-")
    pixels = _numbers(size, "x")
    if numbers is None or len(numbers) > 2 or numbers[-1] < numbers[0]:
        raise UsageError(f"--seeds {seeds!r}: expected one number or a range such as 0-19")
    if pixels is None or len(pixels) != 2 or not all(32 <= side <= 4096 for side in pixels):
        raise UsageError(f"--size {size!r}: expected width and height in pixels such as 848x480")
    check_run_folder(output)
    folder = new_run_folder(output)
    setup = CameraSetup(size=(pixels[0], pixels[1]), hz=fps, wheels=WheelNoise() if wheels else None)
    report = evaluate_camera(
        range(numbers[0], numbers[-1] + 1), folder, load_config(config_file), setup, jobs, log.info
    )
    with writing_to(folder):
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        typer.echo(table_of(report))
    if report["wrong_accepted"] or report["fused_off"]:
        raise typer.Exit(ExitCode.FAILED)
    raise typer.Exit(ExitCode.PARTIAL if report["refused"] else ExitCode.OK)


def _numbers(text: str, between: str) -> list[int] | None:
    """Return the whole numbers of a text; None where it is not made of such."""
    parts = text.split(between)
    return [int(part) for part in parts] if all(part.isascii() and part.isdigit() for part in parts) else None
