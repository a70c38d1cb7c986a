"""`mapfuse-robot evaluate maps`: registration on pairs of real maps."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Json, Method, MethodName, Seed, print_json
from tools.errors import ToolError

log = logging.getLogger(__name__)


def maps(
    data: Annotated[Path, typer.Option(metavar="DIR", envvar="MAPFUSE_DATA", help="Folder of the data sets.")] = Path(
        "../shared/data"
    ),
    method: Method = MethodName.default,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Register pairs of real maps, the second of each redrawn in a random frame, and compare with the truth.

    Exit code 1: a wrong pose was accepted.
    """
    from tools.map_evaluation import evaluate_maps

    report = evaluate_maps(data, method.value, seed, log.info)
    same, different = report["same_place"], report["different_places"]
    if as_json:
        print_json(report)
    else:
        typer.echo(f"{'pair':36} {'verdict':24} {'rms m':>8} {'deg':>7} {'s':>6}")
        for row in report["rows"]:
            error = "       -       -" if row["rms_m"] is None else f"{row['rms_m']:8.3f} {row['rotation_deg']:7.2f}"
            typer.echo(f"{row['pair']:36} {row['verdict']:24} {error} {row['seconds']:6.2f}")
        typer.echo(
            f"same place: {same['right']} of {same['pairs']} right ({same['within_0.10_m_and_1_deg']} within 0.10 m and"
            f" 1 deg), {same['refused']} refused ({same['refused_though_right']} of them though right),"
            f" {same['wrong']} wrong"
        )
        typer.echo(f"different places: {different['accepted']} of {different['pairs']} accepted")
    wrong = same["wrong"] + different["accepted"]
    if wrong:
        raise ToolError(f"{wrong} wrong poses were accepted: see the rows marked WRONG")
