"""`mapfuse-robot evaluate fusion`: the thesis's experiments, chapters 4 and 5, on a set of maps."""

from __future__ import annotations

import logging
import shlex
from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import Seed
from tools.errors import ToolError, UsageError
from tools.exit_codes import ExitCode

log = logging.getLogger(__name__)


def fusion(
    data: Annotated[
        Path, typer.Argument(metavar="SET", help="Folder that `data-set` wrote, or one with map files in it.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for tables and pictures.")],
    only: Annotated[
        str | None,
        typer.Option(metavar="N,N,...", help="Figures and tables by their numbers in the thesis, such as 4.3,5.1."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=100_000, help="Runs of what is random.")] = 100,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time; for true times, no more than cores.")] = 1,
) -> None:
    """Run the thesis's experiments that a set of maps has all for, and write each as table, picture and JSON.

    The same again goes on where it was interrupted. Exit code 3: an experiment that --only names was skipped, or is not
    complete.
    """
    from tools.experiment import ExperimentSettings
    from tools.experiment_report import run_experiments
    from tools.experiments import EXPERIMENTS
    from tools.map_data_set import read_data_set
    from tools.plots import pyplot
    from tools.result_folder import check_experiment_folder

    names = list(EXPERIMENTS) if only is None else only.split(",")
    unknown = [name for name in names if name not in EXPERIMENTS]
    if unknown:
        raise UsageError(f"--only {unknown[0]!r}: expected of {', '.join(EXPERIMENTS)}, with commas between")
    check_experiment_folder(output, data)
    maps = read_data_set(data)
    pyplot()  # raises where there is none, before the work
    output.mkdir(parents=True, exist_ok=True)
    words = ["mapfuse-robot", "evaluate", "fusion", data.name, "-o", output.name]
    words += [] if only is None else ["--only", only]
    command = shlex.join([*words, "--runs", str(runs), "--seed", str(seed)])
    chosen = {name: EXPERIMENTS[name] for name in names}
    done = run_experiments(chosen, maps, ExperimentSettings(runs, seed, jobs), output, command, log.info)
    skipped = [each for each in done if each.skipped is not None]
    if len(skipped) == len(done):
        each = skipped[0]
        raise ToolError(f"{data}: none of {len(done)} experiments can be run on it: {each.name}: {each.skipped}")
    for each in done:
        state = f"skipped: {each.skipped}" if each.skipped else "" if each.complete else "not complete"
        typer.echo(f"{each.name:8}{each.title}{': ' if state else ''}{state}")
    partial = any(not each.complete for each in done) or (only is not None and bool(skipped))
    raise typer.Exit(ExitCode.PARTIAL if partial else ExitCode.OK)
