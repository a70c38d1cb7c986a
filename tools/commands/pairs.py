"""`mapfuse-robot pairs`: pairs of maps with the true relative pose, to measure registration on."""

from __future__ import annotations

import logging
import math
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
    building: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="What a SOURCE was driven in; one for each, in order. [default: its name]"),
    ] = None,
    windows: Annotated[int, typer.Option(min=0, help="Places a SOURCE and band of overlap (low, mid, high).")] = 8,
    kinds: Annotated[
        str,
        typer.Option(
            help="Maps made of each place: two alike, two resolutions, one as a depth camera sees; "
            "bent: two deformed, each by a random field; changed: also with walls gone, things moved, walls thicker."
        ),
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
    bend_m: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--bend-m",
            metavar="LOW HIGH",
            min=0.0,
            help="How far bent and changed maps are bent (rms, m). [default: mixed]",
        ),
    ] = None,
    tries: Annotated[int, typer.Option(min=1, help="Random windows to look at, a SOURCE.")] = 3000,
    join: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR", help="Instead of SOURCEs: a folder of pairs to take, its maps left there; repeatable."
        ),
    ] = None,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time.")] = 1,
) -> None:
    """Make pairs of maps whose relative pose is known, from drives, for `evaluate registration` and `bench fusion`.

    Two windows of one drive share a scan never, and some of their space; the second map is drawn in a random frame.
    Same input and seed, same pairs.
    """
    from tools.pair_files import joined_pairs, write_pairs
    from tools.pair_making import WINDOW_KINDS, WindowPlan
    from tools.public_pairs import ORIGIN, public_pairs
    from tools.recorded_pairs import Drive, recorded_pairs
    from tools.result_folder import new_set_folder

    chosen: list[Path] = sources or []
    tracks: list[Path | None] = [*(trajectory or [])]
    names: list[str | None] = [*(building or [])]
    if sum((bool(chosen), public is not None, bool(join))) != 1:
        raise UsageError("name one or more SOURCEs, or --public with the folder of the data sets, or --join")
    if tracks and len(tracks) != len(chosen):
        raise UsageError(f"{len(tracks)} --trajectory for {len(chosen)} SOURCEs: name one for each, or none")
    if names and len(names) != len(chosen):
        raise UsageError(f"{len(names)} --building for {len(chosen)} SOURCEs: name one for each, or none")
    if bend_m is not None and not 0.0 <= bend_m[0] <= bend_m[1] < math.inf:
        raise UsageError(f"--bend-m {bend_m[0]:g} {bend_m[1]:g}: expected two lengths in m, the smaller first")
    unknown = [kind for kind in kinds.split(",") if kind not in WINDOW_KINDS]
    if unknown:
        raise UsageError(f"--kinds {unknown[0]!r}: expected of {', '.join(WINDOW_KINDS)}, with commas between")
    with new_set_folder(output) as folder:
        if join:
            made, origin = joined_pairs(join), ", ".join(folder.resolve().name for folder in join)
        elif public is not None:
            made, origin = public_pairs(folder / "maps", public, seed, jobs, log.info), ORIGIN
        else:
            none = [None] * len(chosen)
            drives = [Drive(*each) for each in zip(chosen, tracks or none, names or none, strict=True)]
            plan = WindowPlan(windows, wrong, tuple(kinds.split(",")), tries, bend_m)
            made = recorded_pairs(folder / "maps", drives, plan, others or [], seed, jobs, log.info)
            origin = ", ".join(source.name for source in chosen)
        write_pairs(folder, made, origin)
    true = sum(pair.truth is not None for pair in made)
    typer.echo(f"{output}: {true} pairs of one place, {len(made) - true} of two")
