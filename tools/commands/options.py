"""Command-line options that several commands share."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.errors import UsageError

if TYPE_CHECKING:
    from fusion.algorithm3 import Algorithm3Settings
    from tools.config import Config

RecordingPath = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="An MCAP or .db3 file, the folder of a ROS 2 bag, a CARMEN or tinySLAM log, a RealSense .bag, a folder of"
        " depth PNGs.",
    ),
]
Intrinsics = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="3x3 camera matrix of a folder of depth PNGs.  [default: its camera-intrinsics.txt]"
    ),
]
METRES_PER_COUNT = 0.001
DepthUnit = Annotated[
    float | None,
    typer.Option(min=1e-6, max=1.0, metavar="M", help="Metres per count of a folder of depth PNGs.  [default: 0.001]"),
]
LidarPort = Annotated[
    str | None, typer.Option("--lidar", metavar="PORT", help="The RPLIDAR's port: a path or any pyserial URL.")
]
DepthPort = Annotated[
    str | None,
    typer.Option(
        "--depth",
        metavar="NODE",
        help="The depth camera: auto, a node such as /dev/video2, or a simulated one, emulated:DRIVE (office,"
        " wings-west, wings-east) or emulated:FILE (of `emulate lidar --car`).",
    ),
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


def jobs_of(text: str) -> int:
    """Return how many processes a --jobs asks for: all and 0 mean one for each core that may be used."""
    try:
        number = 0 if text == "all" else int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise typer.BadParameter(f"{text}: expected a number of processes, or all")
    return number or len(os.sched_getaffinity(0))


Jobs = Annotated[
    int, typer.Option("--jobs", metavar="N|all", parser=jobs_of, help="Processes at a time; all (or 0): every core.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of the random samples; same seed, same result.")]


def finite(value: float | None) -> float | None:
    """Refuse nan and inf, which pass every limit of an option or undo it."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


TurningRadius = Annotated[
    float,
    typer.Option("--radius", metavar="M", min=0.2, max=100.0, callback=finite, help="Turning radius of the rear axle."),
]
TimeLimit = Annotated[
    float, typer.Option("--time-limit", metavar="S", min=0.0, callback=finite, help="The longest search for one path.")
]


class MethodName(str, Enum):
    """How maps are registered, see fusion.registration."""

    default = "default"
    thesis = "thesis"


class ScaleName(str, Enum):
    """Where the scale between two maps comes from (thesis section 4.1.3.1)."""

    known = "known"
    estimate = "estimate"


class CommonCell(str, Enum):
    """The cell on which maps of two resolutions are matched (thesis section 5.3)."""

    coarse = "coarse"
    fine = "fine"


Method = Annotated[
    MethodName,
    typer.Option(
        "--method", help="How: the default, or Algorithm 3 of the thesis, which the options from here on set."
    ),
]
Detector = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="kaze, akaze, sift, orb, brisk, harris, shi-tomasi, fast, agast, mser."),
]
Descriptor = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="sift, kaze, akaze, orb, brisk.  [default: the detector's, KAZE's: sift]"),
]
Alpha = Annotated[
    str | None,
    typer.Option(
        metavar="P|auto", help="Least p(free) of cells; auto: of several the best; 0: the map.  [default: 0.99]"
    ),
]
Scale = Annotated[ScaleName | None, typer.Option(help="From the resolutions, or by the matches.  [default: known]")]
Ratio = Annotated[float | None, typer.Option(metavar="R", help="Of the ratio test, on squares.  [default: 0.6]")]
TolerancePx = Annotated[float | None, typer.Option(metavar="PX", help="Of MSAC, in cells.  [default: 1.5]")]
Trials = Annotated[int | None, typer.Option(metavar="N", help="Of MSAC, at most.  [default: 1000]")]
Confidence = Annotated[float | None, typer.Option(metavar="P", help="Of MSAC, to end early.  [default: 0.99]")]
CommonCellOption = Annotated[
    CommonCell | None,
    typer.Option("--common-cell", help="The coarser or the finer map's cell for both.  [default: coarse]"),
]


def thesis_settings(
    method: MethodName,
    *,
    detector: str | None,
    descriptor: str | None,
    alpha: str | None,
    scale: ScaleName | None,
    ratio: float | None,
    tolerance_px: float | None,
    trials: int | None,
    confidence: float | None,
    common_cell: CommonCell | None,
) -> Algorithm3Settings:
    """Return the thesis's settings with the options that are given; raise UsageError for what cannot be."""
    options = {
        "detector": detector,
        "descriptor": descriptor,
        "alpha": alpha,
        "scale": scale,
        "ratio": ratio,
        "tolerance-px": tolerance_px,
        "trials": trials,
        "confidence": confidence,
        "common-cell": common_cell,
    }
    given = [name for name, value in options.items() if value is not None]
    if given and method != MethodName.thesis:
        raise UsageError(f"--{', --'.join(given)}: only with --method thesis")
    from fusion.algorithm3 import THESIS
    from fusion.errors import FusionError
    from fusion.features import FeatureMethod

    try:
        return replace(
            THESIS,
            features=FeatureMethod(detector or THESIS.features.detector, descriptor or ""),
            alpha=THESIS.alpha if alpha is None else alpha_of(alpha),
            scale=THESIS.scale if scale is None else scale.value,
            max_ratio=THESIS.max_ratio if ratio is None else ratio,
            tolerance_px=THESIS.tolerance_px if tolerance_px is None else tolerance_px,
            trials=THESIS.trials if trials is None else trials,
            confidence=THESIS.confidence if confidence is None else confidence,
            common_cell=THESIS.common_cell if common_cell is None else common_cell.value,
        )
    except FusionError as error:
        raise UsageError(f"--method thesis: {error}") from error


def alpha_of(text: str) -> float | None:
    """Return the number of an --alpha, None for auto; raise UsageError."""
    if text == "auto":
        return None
    try:
        return float(text)
    except ValueError as error:
        raise UsageError(f"--alpha {text}: must be a number from 0.01 to 0.99, 0 or auto") from error


def refuse_folder_options(recording: Path, intrinsics: Path | None, depth_unit: float | None = None) -> None:
    """Raise UsageError where what only a folder of depth PNGs needs is given for a recording that tells it itself."""
    from drivers.depth_folder import is_depth_folder

    given = [name for name, value in (("--intrinsics", intrinsics), ("--depth-unit", depth_unit)) if value is not None]
    if given and recording.exists() and not is_depth_folder(recording):
        raise UsageError(f"{' and '.join(given)}: only for a folder of depth PNGs; {recording} tells that itself")


def require_sensor(lidar: str | None, depth: str | None) -> None:
    """Raise UsageError where no sensor is named."""
    if lidar is None and depth is None:
        raise UsageError("no sensor: name a lidar (--lidar PORT), a depth camera (--depth auto), or both")


def load_config(path: Path | None, resolution_m: float | None = None, cells_per_meter: float | None = None) -> Config:
    """Return the effective configuration; raise ConfigError."""
    from tools.config import load

    return load(path).with_resolution(resolution_m, cells_per_meter)


def print_json(values: Mapping[str, object]) -> None:
    """Print one JSON object on stdout."""
    json.dump(values, sys.stdout, indent=2)
    sys.stdout.write("\n")
