"""`mapfuse-robot learn`: weights of the registration's ranking, from pairs of maps."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Seed

log = logging.getLogger(__name__)


def learn(
    pairs: Annotated[list[Path], typer.Argument(metavar="PAIRS...", help="Folders that `pairs` wrote.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The weights, as text (.json).")],
    cache: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep each pair's hypotheses here (.npz), for one version of the program."),
    ] = None,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time.")] = 1,
) -> None:
    """Learn how the registration weighs its evidence, and print what to expect on a building that was left out.

    Needs the extra [learn]. Same pairs and seed, same file.
    """
    from tools.hypothesis_pools import keyed_pairs, pools_of
    from tools.ranking_learning import Growth, check_installed, held_out_scores, learned, write_weights
    from tools.ranking_scores import held_out_lines
    from tools.results import check_new_file

    check_installed()
    for file in (output, *([cache] if cache else [])):
        check_new_file(file)
    keyed = {key: pair for folder in pairs for key, pair in keyed_pairs(folder).items()}
    pools = pools_of(keyed, seed, jobs, cache, log.info)
    held_out = held_out_scores(pools, Growth(), log.info, jobs)
    words = " ".join([*(folder.resolve().name for folder in pairs), f"--seed {seed}"])
    stored = learned(pools, Growth(), f"{len(pools)} pairs: mapfuse-robot learn {words}", held_out)
    write_weights(output, stored)
    for line in held_out_lines(held_out, (stored["slope"], stored["offset"])):
        typer.echo(line)
    typer.echo(f"{output}: {len(stored['trees'])} trees, learned from {len(pools)} pairs")
