"""`mapfuse-robot bench fusion`: the registration of maps beside its peers."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import Json, Seed, print_json

log = logging.getLogger(__name__)


def fusion(
    pairs: Annotated[
        Path, typer.Argument(metavar="PAIRS", help="Folder of a pair list: pairs.json and the maps it names.")
    ],
    sample: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, help="So many of the pairs, each kind in its share; a quarter are wrong pairs."
        ),
    ] = 130,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--method", metavar="NAME", help="Only this method, named as in the table; repeatable. [default: all]"
        ),
    ] = None,
    seed: Seed = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Also write report.json, with a row a pair.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Register the same pairs of maps by this project's default and by its peers, and count the right poses.

    The thesis's Algorithm 3 is this project's own code, at the coarser map's resolution; once with settings that work,
    once with the thesis's own. m-explore (ROS) is imitated: its grids as pictures, its features, OpenCV's affine
    matcher and its confidence; not its ROS nodes, bundle adjustment and merging of many maps; the scale is held at 1.
    Fourier-Mellin is the textbook's, without scale, both of its half turns tried. No peer's code is used.

    aligned: the best pose is right, whatever the method's verdict. merged: what its own verdict lets through. CPU
    seconds a pair are without imports, reading and compilation; each method runs in a process of its own.
    """
    import json

    from tools.fusion_bench import compare_methods
    from tools.results import check_run_folder, new_run_folder, writing_to

    if output is not None:
        check_run_folder(output)
    report = compare_methods(pairs, sample, methods or None, seed, log.info)
    if output is not None:
        folder = new_run_folder(output)
        with writing_to(folder):
            (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        _print(report)


def _print(report: dict[str, Any]) -> None:
    """Print a row for each method, what was merged, and what the names mean."""
    typer.echo(f"{report['pairs']}: {report['sampled']} of {report['of']} pairs, seed {report['seed']}")
    methods = report["methods"]
    columns = list(methods[0]["aligned"])
    typer.echo(f"  {'aligned of pairs':<17}{''.join(f'{name:>11}' for name in columns)}  CPU s median / p95  peak MB")
    for method in methods:
        shares = "".join(f"{_of(method['aligned'][name], 'right'):>11}" for name in columns)
        cpu = f"{method['cpu_s']['median']:.2f} / {method['cpu_s']['p95']:.2f}"
        typer.echo(f"  {method['name']:<17}{shares}{cpu:>20}{method['peak_mb']:>9.0f}")
    typer.echo(f"  {'merged':<17}{'right':>11}{'wrong pose':>12}{'false, same building':>22}{'false, other':>14}")
    for method in methods:
        merged = method["merged"]
        if merged is None:
            typer.echo(f"  {method['name']:<17}{'no verdict':>11}")
            continue
        right = f"{merged['right']}/{merged['of_pairs']}"
        same, other = (_of(merged[f"false_{which}_building"], "merged") for which in ("same", "other"))
        typer.echo(f"  {method['name']:<17}{right:>11}{merged['wrong']:>12}{same:>22}{other:>14}")
    for method in methods:
        typer.echo(f"  {method['name']:<17} {method['note']}")


def _of(share: dict[str, int], counted: str) -> str:
    return f"{share[counted]}/{share['pairs']}"
