"""`mapfuse-robot demo`: the main job without any hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results; emptied of a former demo.")
    ] = Path("runs/demo"),
    model: Annotated[str, typer.Option(help="The emulated lidar: A2M8 or A2M12.")] = "A2M8",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensor noise.")] = 0,
) -> None:
    """Map a building with an emulated RPLIDAR on a simulated car: `run`, Ctrl-C, `replay`, and the error against truth.

    Takes about two minutes. All data are simulated; everything above the serial port is what runs on the car.
    """
    from tools.demo_mission import run_demo

    run_demo(output, model, seed)
