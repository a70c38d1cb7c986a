"""`mapfuse-robot align`: the relative pose of two maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, PresetName, RegistrationPreset, Seed, print_json
from tools.exit_codes import ExitCode


def align(
    a: Annotated[Path, typer.Argument(metavar="A", help="The map whose frame the answer is in: .yaml or .npz.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="The map to place in it.")],
    preset: RegistrationPreset = PresetName.default,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Find the pose of map B's frame in map A's frame, without any initial guess.

    Exit code 3: no pose was found that can be trusted; the best hypothesis, if any, is still shown.
    """
    from tools.map_fusion import align_maps

    report = align_maps(a, b, preset=preset.value, seed=seed)
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
