"""Command-line options that several commands share."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from tools.config import Config

LidarPort = Annotated[
    str, typer.Option("--lidar", metavar="PORT", help="The RPLIDAR's port: a path or any pyserial URL.")
]
ConfigFile = Annotated[Path | None, typer.Option("--config", metavar="FILE", help="YAML configuration.")]
OutputFolder = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder for the results. [default: runs/<time>]")
]
ResolutionM = Annotated[float | None, typer.Option("--resolution", metavar="M", help="Metres a map cell.")]
CellsPerMeter = Annotated[float | None, typer.Option("--cells-per-meter", metavar="N", help="The same, inverted.")]
Resume = Annotated[
    Path | None,
    typer.Option(
        "--resume",
        metavar="DIR",
        help="Go on with the map of an earlier run's folder; until the car is recognised there, its way stays apart.",
    ),
]
MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="MAP",
        help="Find the car on this saved or fused map (.yaml, .npz), with no hint where it is, and follow it there.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of the random samples; same seed, same result.")]


def finite(value: float) -> float:
    """Refuse nan and inf, which pass every limit of an option or undo it."""
    if not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


TurningRadius = Annotated[
    float,
    typer.Option("--radius", metavar="M", min=0.2, max=100.0, callback=finite, help="Turning radius of the rear axle."),
]
TimeLimit = Annotated[
    float, typer.Option("--time-limit", metavar="S", min=0.0, callback=finite, help="The longest search for one path.")
]


class PresetName(str, Enum):
    """Named settings of the registration, see fusion.registration.PRESETS."""

    default = "default"
    thesis = "thesis"


RegistrationPreset = Annotated[
    PresetName,
    typer.Option("--preset", help="Settings of the registration: these, or the thesis's own; see docs/fusion.md."),
]


def load_config(path: Path | None, resolution_m: float | None = None, cells_per_meter: float | None = None) -> Config:
    """Return the effective configuration; raise ConfigError."""
    from tools.config import load

    return load(path).with_resolution(resolution_m, cells_per_meter)


def print_json(values: Mapping[str, object]) -> None:
    """Print one JSON object on stdout."""
    json.dump(values, sys.stdout, indent=2)
    sys.stdout.write("\n")
