"""`mapfuse-robot align`: the relative pose of two maps."""

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
    Ratio,
    Scale,
    Seed,
    TolerancePx,
    Trials,
    print_json,
    thesis_settings,
)
from tools.exit_codes import ExitCode


def align(
    a: Annotated[Path, typer.Argument(metavar="A", help="The map whose frame the answer is in: .yaml or .npz.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The map to place in it.")],
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
    from tools.map_fusion import align_maps

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
    report = align_maps(a, b, method=method.value, settings=settings, seed=seed)
    if as_json:
        print_json(report)
    else:
        typer.echo(f"{'accepted' if report['accepted'] else 'refused'}: {report['reason']}")
        if report["dx"] is not None:
            typer.echo(
                f"  pose of B in A  x {report['dx']:.3f} m, y {report['dy']:.3f} m, {report['theta_deg']:.2f} deg"
            )
            typer.echo(f"  acceptance index {report['acceptance']:.3f}, overlap {report['overlap']:.0%}")
    raise typer.Exit(ExitCode.OK if report["accepted"] else ExitCode.PARTIAL)
