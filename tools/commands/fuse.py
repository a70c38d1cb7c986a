"""`mapfuse-robot fuse`: several maps into one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import (
    Alpha,
    CommonCellOption,
    Confidence,
    Descriptor,
    Detector,
    Json,
    Method,
    MethodName,
    OutputFolder,
    Ratio,
    Scale,
    Seed,
    TolerancePx,
    Trials,
    print_json,
    thesis_settings,
)
from tools.exit_codes import ExitCode


def fuse(
    maps: Annotated[
        list[Path],
        typer.Argument(metavar="A B", help="Two maps: .yaml or .npz, any resolutions; of one alone a copy is made."),
    ],
    output: OutputFolder = None,
    seed: Seed = 0,
    as_json: Json = False,
    method: Method = MethodName.default,
    detector: Detector = None,
    descriptor: Descriptor = None,
    alpha: Alpha = None,
    scale: Scale = None,
    ratio: Ratio = None,
    tolerance_px: TolerancePx = None,
    trials: Trials = None,
    confidence: Confidence = None,
    common_cell: CommonCellOption = None,
) -> None:
    """Fuse two maps of unknown relative pose into one.

    Writes global_0.yaml/.pgm/.npz/.png and report.json. The global frame is that of the map with the most known area.
    Exit code 3: the maps do not belong together as far as can be told, so that each became a global map of its own
    (global_1 too), or a map without known cells was skipped.
    """
    from tools.map_fusion import fuse_maps

    settings = thesis_settings(
        method,
        detector=detector,
        descriptor=descriptor,
        alpha=alpha,
        scale=scale,
        ratio=ratio,
        tolerance_px=tolerance_px,
        trials=trials,
        confidence=confidence,
        common_cell=common_cell,
    )
    folder, report = fuse_maps(maps, output, method=method.value, settings=settings, seed=seed)
    if as_json:
        print_json(report)
    else:
        for pair in report["pairs"]:
            typer.echo(f"{'fused' if pair['accepted'] else 'not fused'}: {pair['reason']}")
        for entry in report["maps"]:
            where = "skipped" if entry["group"] is None else f"in global_{entry['group']}"
            typer.echo(f"  {entry['file']}: {where}")
        count = len({entry["group"] for entry in report["maps"]} - {None})
        typer.echo(f"{folder}: report.json and {count or 'no'} global map{'' if count == 1 else 's'}")
    groups = {entry["group"] for entry in report["maps"]}
    raise typer.Exit(ExitCode.OK if groups == {0} else ExitCode.PARTIAL)
