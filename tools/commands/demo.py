"""`mapfuse-robot demo`: the main job without any hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results; emptied of a former demo.")
    ] = Path("runs/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sensor noise and of the random samples.")] = 0,
) -> None:
    """Two emulated cars map a building, their maps become one, and a path is planned on it; scored against the truth.

    Takes about two minutes. All data are simulated; everything above the serial ports is what runs on the cars. Exit
    code 3: the maps were not fused.
    """
    from tools.demo_mission import run_demo

    raise typer.Exit(run_demo(output, seed))
