"""`mapfuse-robot pairs`: pairs of maps with the true relative pose, to measure registration on."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Seed
from tools.errors import UsageError

log = logging.getLogger(__name__)


def pairs(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="New folder for maps and pairs.json.")],
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="SOURCE...", help="CARMEN logs with corrected poses; or recordings, each with its --trajectory."
        ),
    ] = None,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(metavar="TUM", help="The trajectory.tum that `replay` wrote of a SOURCE; one for each, in order."),
    ] = None,
    windows: Annotated[int, typer.Option(min=0, help="Places a SOURCE and band of overlap (low, mid, high).")] = 8,
    kinds: Annotated[
        str, typer.Option(help="Maps made of each place: two alike, two resolutions, and one as a depth camera sees.")
    ] = "lidar,resolution,camera",
    wrong: Annotated[
        int, typer.Option(min=0, help="Places a SOURCE without common free space, and pairs with --others.")
    ] = 12,
    others: Annotated[
        list[Path] | None,
        typer.Option(metavar="MAP", help="A map of a building that is none of the SOURCEs'; repeatable."),
    ] = None,
    public: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Instead of SOURCEs: the set of about 950 pairs from this folder of data sets."
        ),
    ] = None,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time.")] = 1,
) -> None:
    """Make pairs of maps whose relative pose is known, from drives, for `evaluate registration` and `bench fusion`.

    Two windows of one drive share a scan never, and some of their space; the second map is drawn in a random frame.
    Same input and seed, same pairs.
    """
    from tools.pair_files import write_pairs
    from tools.pair_making import RESOLUTIONS_M, WindowPlan
    from tools.public_pairs import ORIGIN, public_pairs
    from tools.recorded_pairs import Drive, new_pair_folder, recorded_pairs

    chosen: list[Path] = sources or []
    tracks: list[Path | None] = [*(trajectory or [])]
    if bool(chosen) == (public is not None):
        raise UsageError("name one or more SOURCEs, or --public with the folder of the data sets")
    if tracks and len(tracks) != len(chosen):
        raise UsageError(f"{len(tracks)} --trajectory for {len(chosen)} SOURCEs: name one for each, or none")
    unknown = [kind for kind in kinds.split(",") if kind not in RESOLUTIONS_M]
    if unknown:
        raise UsageError(f"--kinds {unknown[0]!r}: expected of {', '.join(RESOLUTIONS_M)}, with commas between")
    with new_pair_folder(output) as folder:
        if public is not None:
            made, origin = public_pairs(folder / "maps", public, seed, jobs, log.info), ORIGIN
        else:
            drives = [
                Drive(source, track) for source, track in zip(chosen, tracks or [None] * len(chosen), strict=True)
            ]
            plan = WindowPlan(windows, wrong, tuple(kinds.split(",")))
            made = recorded_pairs(folder / "maps", drives, plan, others or [], seed, jobs, log.info)
            origin = ", ".join(source.name for source in chosen)
        write_pairs(folder, made, origin)
    true = sum(pair.truth is not None for pair in made)
    typer.echo(f"{output}: {true} pairs of one place, {len(made) - true} of two")
