"""`mapfuse-robot align`: the relative pose of two maps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

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
    Ratio,
    Scale,
    Seed,
    TolerancePx,
    Trials,
    print_json,
    thesis_settings,
)
from tools.exit_codes import ExitCode

_LEAST_SHOWN = 0.0005  # of a probability with three digits


def align(
    a: Annotated[Path, typer.Argument(metavar="A", help="The map whose frame the answer is in: .yaml or .npz.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The map to place in it.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for alignment.png, the verdict as a picture."),
    ] = None,
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
    """Find the pose of map B's frame in map A's frame, without any initial guess.

    Exit code 3: no pose was found that can be trusted; the best hypothesis, if any, is still shown.
    """
    from tools.map_alignment import align_maps

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
    report = align_maps(a, b, output, method=method.value, settings=settings, seed=seed)
    if as_json:
        print_json(report)
    else:
        for line in _in_words(report):
            typer.echo(line)
        if output is not None:
            typer.echo(f"{output}: alignment.png, alignment.json")
    raise typer.Exit(ExitCode.OK if report["accepted"] else ExitCode.PARTIAL)


def _in_words(report: dict[str, Any]) -> Iterator[str]:
    """Yield the verdict, the pose with its standard deviations, and the other places."""
    verdict = "accepted" if report["accepted"] else "refused"
    chance = "" if report["probability"] is None else f" (probability {report['probability']:.3f})"
    yield f"{verdict}{chance}: {report['reason']}"
    if report["dx"] is None:
        return
    yield f"  pose of B in A  {_pose(report)}"
    if report["covariance"] is not None:
        x, y, yaw = (math.sqrt(max(report["covariance"][n][n], 0.0)) for n in range(3))
        yield f"  one sigma       x {x:.3f} m, y {y:.3f} m, {math.degrees(yaw):.2f} deg"
    yield f"  acceptance index {report['acceptance']:.3f}, overlap {report['overlap']:.0%}"
    for other in report["alternatives"]:
        if other["probability"] < _LEAST_SHOWN:
            continue
        yield f"  or             {_pose(other)} (probability {other['probability']:.3f})"


def _pose(fields: dict[str, Any]) -> str:
    return f"x {fields['dx']:.3f} m, y {fields['dy']:.3f} m, {fields['theta_deg']:.2f} deg"
