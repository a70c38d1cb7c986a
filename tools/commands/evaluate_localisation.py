"""`mapfuse-robot evaluate localisation`: rooms that the simulated car only looked into when it mapped."""

from __future__ import annotations

import logging
from typing import Annotated

import typer

from tools.commands.options import Json, Seed, print_json

log = logging.getLogger(__name__)


def localisation(
    count: Annotated[int, typer.Option("-n", "--maps", min=1, help="Maps, of seeds that follow each other.")] = 1,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Map the built-in office by a simulated round, then drive through the rooms it only looked into, and compare.

    What is compared is the place that tracking on the saved map believes in, and the simulator's truth.
    """
    from tools.localisation_evaluation import evaluate_localisation, table_of

    report = evaluate_localisation(range(seed, seed + count), log.info)
    if as_json:
        print_json(report)
    else:
        for line in table_of(report):
            typer.echo(line)
