"""`mapfuse-robot data-set`: a set of maps of drives, to reproduce the thesis's experiments on."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Seed
from tools.errors import UsageError


def data_set(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="CARMEN log with corrected poses; or a recording, with --trajectory; for the kind halmstad a folder "
            "maps/BUILDING of that data set.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="New folder for maps and set.json.")],
    kind: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            help="heterogeneous: one environment, several resolutions and scan rates; parts: two parts that overlap, "
            "each at several resolutions; robots: each robot's part, at its resolution and rate; halmstad: tablet maps "
            "of one building with its layout; growing: two robots' maps, step by step (of two LOGs: of two buildings).",
        ),
    ] = "heterogeneous",
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(metavar="TUM", help="The trajectory.tum that `replay` wrote of a LOG; one for each, in order."),
    ] = None,
    cells_per_meter: Annotated[
        str | None, typer.Option(metavar="R,R,...", help="Resolutions r.  [default: the kind's]")
    ] = None,
    scan_every: Annotated[
        str | None, typer.Option(metavar="K,K,...", help="Scan rates: every k-th scan.  [default: the kind's]")
    ] = None,
    robots: Annotated[
        int, typer.Option(min=2, max=50, help="Robots of the kind robots, each with a part of the drive.")
    ] = 6,
    overlap: Annotated[
        str, typer.Option(metavar="low|mid|high", help="Free space that the two parts of the kind parts share.")
    ] = "low",
    seed: Seed = 0,
) -> None:
    """Make a set of maps whose relative poses are known, for `evaluate fusion` (thesis section 4.1.1).

    Same logs and seed, same maps.
    """
    from dataclasses import replace

    from tools.data_set_kinds import KINDS
    from tools.data_set_plan import DataSetPlan
    from tools.log_windows import BAND_LIMITS
    from tools.map_data_set import write_data_set
    from tools.number_lists import positive_numbers
    from tools.recorded_pairs import Drive
    from tools.result_folder import new_set_folder

    if kind not in KINDS:
        raise UsageError(f"--kind {kind!r}: expected one of {', '.join(KINDS)}")
    if overlap not in BAND_LIMITS:
        raise UsageError(f"--overlap {overlap!r}: expected one of {', '.join(BAND_LIMITS)}")
    tracks: list[Path | None] = [*(trajectory or [])]
    if tracks and len(tracks) != len(logs):
        raise UsageError(f"{len(tracks)} --trajectory for {len(logs)} LOGs: name one for each, or none")
    least, most = KINDS[kind].drives
    if len(logs) < least or (most is not None and len(logs) > most):
        wanted = f"{least}" if least == most else f"{least} or more" if most is None else f"{least} to {most}"
        raise UsageError(f"--kind {kind}: takes {wanted} LOG, not {len(logs)}")
    plan = DataSetPlan(
        cells_per_meter=None
        if cells_per_meter is None
        else positive_numbers(cells_per_meter, float, "--cells-per-meter"),
        scan_every=None if scan_every is None else positive_numbers(scan_every, int, "--scan-every"),
        robots=robots,
        overlap=overlap,
        seed=seed,
    )
    drives = [Drive(*each) for each in zip(logs, tracks or [None] * len(logs), strict=True)]
    words = ["mapfuse-robot", "data-set", *(log.name for log in logs), "-o", output.name, "--kind", kind]
    for option, text in (("--cells-per-meter", cells_per_meter), ("--scan-every", scan_every)):
        words += [] if text is None else [option, text]
    words += ["--robots", str(robots)] if kind == "robots" else ["--overlap", overlap] if kind == "parts" else []
    for track in trajectory or []:
        words += ["--trajectory", f"{track.parent.name}/{track.name}"]
    with new_set_folder(output) as folder:
        made = KINDS[kind].make(drives, plan, folder)
        write_data_set(replace(made, kind=kind, command=shlex.join([*words, "--seed", str(seed)])))
    typer.echo(f"{output}: {len(made.maps)} maps. {made.source}")
