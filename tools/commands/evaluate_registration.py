"""`mapfuse-robot evaluate registration`: registration on a list of map pairs."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tools.commands.options import Json, MethodName, Seed, print_json
from tools.errors import UsageError

if TYPE_CHECKING:
    from tools.pair_files import MapPair
    from tools.registration_evaluation import Register

log = logging.getLogger(__name__)


def registration(
    pairs: Annotated[Path, typer.Argument(metavar="PAIRS", help="Folder with a pairs.json, as `pairs` writes.")],
    method: Annotated[
        MethodName, typer.Option("--method", help="The registration's default, or the thesis's Algorithm 3.")
    ] = MethodName.default,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WORDS",
            help="Only these pairs: words with / between, such as lidar/low, camera, true, wrong/same, F5. Repeatable.",
        ),
    ] = None,
    sample: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="A random sample of so many of them. [default: all]")
    ] = None,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes at a time.")] = 1,
    leave_one_out: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PAIRS",
            help="Learn the ranking anew for each pair, from these pairs and PAIRS without its buildings; repeatable.",
        ),
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --leave-one-out: hypotheses of pairs, as `learn --cache` keeps them."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for rows.jsonl, report.json and plots."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Register every pair of a list and compare with the truth: success, wrong merges, calibration, accuracy, time.

    A pair is aligned when the best hypothesis is right, be it accepted or refused. Pairs of different places have no
    right pose: accepting one is a false merge.
    """
    from contextlib import ExitStack
    from functools import partial

    from tools.registration_evaluation import chosen_pairs, evaluate_registration, register_by
    from tools.registration_scores import failure_lines, table_of
    from tools.result_folder import REGISTRATION, check_result_folder, new_results
    from tools.results import Report, writing_to

    if output is not None:
        check_result_folder(output, REGISTRATION)
    if cache is not None and leave_one_out is None:
        raise UsageError("--cache: only with --leave-one-out")
    if leave_one_out is not None and method != MethodName.default:
        raise UsageError(f"--leave-one-out: method {method.value} learns nothing: leave one of the two out")
    chosen = chosen_pairs(pairs, only or [], sample, seed)
    registered: Register | list[Register] = partial(register_by, method.value)
    if leave_one_out is not None:
        registered = _left_out(chosen, [pairs, *leave_one_out], cache, seed, jobs)
    with ExitStack() as open_files:
        rows_file = None
        if output is not None:
            with writing_to(output):
                rows_file = open_files.enter_context(
                    (new_results(output, REGISTRATION) / "rows.jsonl").open("w", encoding="utf-8")
                )

        def on_row(row: Report) -> None:
            verdict = f"{'right' if row['aligned'] else 'wrong'}, {'accepted' if row['accepted'] else 'refused'}"
            log.info("%s: %s (%s)", row["pair"], verdict, row["reason"])
            if rows_file is not None:
                rows_file.write(json.dumps(row) + "\n")
                rows_file.flush()

        report = evaluate_registration(pairs, registered, chosen, seed, jobs, on_row)
    trained = [folder.resolve().name for folder in leave_one_out or []]
    report = {"method": method.value, "only": only or [], "leave_one_out": trained, **report}
    if output is not None:
        _save(output, report)
    if as_json:
        print_json(report)
        return
    for line in (*table_of(report), "", *failure_lines(report)):
        typer.echo(line)


def _left_out(
    chosen: Sequence[MapPair], lists: Sequence[Path], cache: Path | None, seed: int, jobs: int
) -> list[Register]:
    """Return a registration for each chosen pair, its ranking learned from the lists without the pair's buildings."""
    from tools.hypothesis_pools import keyed_pairs, pools_of
    from tools.ranking_learning import check_installed
    from tools.registration_evaluation import left_out_registrations
    from tools.results import check_new_file

    check_installed()
    if cache is not None:
        check_new_file(cache)
    keyed = {key: pair for folder in lists for key, pair in keyed_pairs(folder).items()}
    return left_out_registrations(chosen, pools_of(keyed, seed, jobs, cache, log.info), log.info, jobs)


def _save(folder: Path, report: dict[str, Any]) -> None:
    from tools.registration_plots import draw_reliability, draw_scores, draw_success
    from tools.results import writing_to

    with writing_to(folder):
        summary = {key: value for key, value in report.items() if key != "rows"}
        (folder / "report.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        draw_success(folder / "success.png", report)
        draw_reliability(folder / "reliability.png", report)
        draw_scores(folder / "scores.png", report, report["rows"])
