"""`mapfuse-robot bench plan`: what planning costs, and how long its paths are, beside OMPL with numpy."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import Json, print_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from planning.costmap import UnknownSpace
    from tools.results import Report

log = logging.getLogger(__name__)


def plan(
    problems: Annotated[
        Path | None,
        typer.Argument(
            metavar="PROBLEMS.json",
            help="{map: [{start, goal, ref}]}, with <map>.yaml beside it.  [default: $MAPFUSE_DATA/maps_planning]",
        ),
    ] = None,
    start: Annotated[bool, typer.Option("--start/--no-start", help="Also how long a process takes to start.")] = True,
    leaks: Annotated[
        int, typer.Option(min=0, metavar="N", help="Also what N plans leave behind, after as many before.")
    ] = 1000,
    cancels: Annotated[
        int, typer.Option(min=0, metavar="N", help="Also how long N cancelled plans take to come back.")
    ] = 50,
    unknown_free: Annotated[
        bool, typer.Option("--unknown-free/--unknown-forbidden", help="Let paths cross unseen space, as `ref` does.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Measure plans on a list of problems, each once: five planners, CPU time, costmap and compiled code ready.

    First path in ms, length in shares of `ref` at the end (car: 300 ms of CPU; others: when they end), and faults that
    an independent check found. The peer is OMPL's RRT-Connect and simplifier with a numpy state checker, 5 s at most.
    """
    from planning.costmap import UnknownSpace as Unknown
    from tools.errors import UsageError
    from tools.plan_bench import bench_plans, cpu_name

    if problems is None:
        if "MAPFUSE_DATA" not in os.environ:
            raise UsageError("no problems: name a problems.json, or set MAPFUSE_DATA to the folder of data sets")
        problems = Path(os.environ["MAPFUSE_DATA"]) / "maps_planning" / "problems.json"
    unknown = Unknown.free if unknown_free else Unknown.forbidden

    def tell(text: str) -> None:
        if not as_json:
            typer.echo(text)

    report: Report = {"cpu": cpu_name(), "plans": []}
    tell(f"mapfuse-robot bench plan {problems}  (CPU time, {report['cpu']})")
    tell(f"  {'':50}{'map':<10} solved   first path ms, median p95 max   length/ref, median p95   faults")
    for row in bench_plans(problems, unknown, log.info):
        report["plans"].append(row)
        tell(_plans_line(row))
    for line in _besides(report, problems, unknown, start=start, cancels=cancels, leaks=leaks):
        tell(line)
    if as_json:
        print_json(report)


def _besides(
    report: Report, problems: Path, unknown: UnknownSpace, *, start: bool, cancels: int, leaks: int
) -> Iterator[str]:
    """Measure what is asked for besides plans into the report, and yield it in words."""
    from tools.plan_bench import bench_cancel, bench_leaks, bench_start

    if start:
        report["start"] = bench_start()
        for name, taken in report["start"].items():
            cached = "compiles" if name == "first" else "compiled code at hand"
            yield f"  {name} start ({cached}): {taken['wall_s']} s, {taken['cpu_s']} s of CPU"
    if cancels:
        report["cancel"] = bench_cancel(problems, unknown, cancels)
        for name in ("cancel", "ctrl_c"):
            late = report["cancel"][name]
            yield f"  back after {name}: median {late['median']:.1f} ms, most {late['max']:.1f} ms (wall)"
    if leaks:
        report["leaks"] = bench_leaks(problems, unknown, leaks)
        before, after = report["leaks"]["before"], report["leaks"]["after"]
        for what, label in (("resident_mb", "MB"), ("descriptors", "descriptors"), ("threads", "threads")):
            yield f"  {leaks} plans: {before[what]} {label} before, {after[what]} after"


def _plans_line(row: Report) -> str:
    first, ratio = row["first_ms"], row["ratio"]
    numbers = "-" if not first else f"{first['median']:14.1f} {first['p95']:8.1f} {first['max']:8.1f}"
    lengths = "" if not ratio else f"{ratio['median']:14.3f} {ratio['p95']:7.3f}"
    faults = "-" if row["faults"] is None else row["faults"]
    solved = f"{row['solved']:>2}/{row['problems']:<3}"
    return f"  {row['contender']:<50}{row['map']:<10} {solved} {numbers} {lengths} {faults:>8}"
