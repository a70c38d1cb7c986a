"""`mapfuse-robot fuse`: several maps into one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import (
    Alpha,
    CommonCellOption,
    Confidence,
    Descriptor,
    Detector,
    Jobs,
    Json,
    Method,
    MethodName,
    OutputFolder,
    Ratio,
    Scale,
    Seed,
    TolerancePx,
    Trials,
    print_json,
    thesis_settings,
)
from tools.errors import UsageError
from tools.exit_codes import ExitCode


def fuse(
    maps: Annotated[
        list[Path],
        typer.Argument(
            metavar="MAP|FOLDER...",
            help="Maps: .yaml or .npz, any resolutions; of one alone a copy is made. A FOLDER stands for the maps in"
            " it: .yaml files that name an image, .npz files (of the two of one name the .npz), and subfolders that"
            " `run` or `replay` left, one map each.",
        ),
    ],
    output: OutputFolder = None,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch",
            help="Until Ctrl-C: each FOLDER is that of a robot that still maps, or holds one for each robot, and may"
            " appear later. Its newest map counts.",
        ),
    ] = False,
    every: Annotated[
        float, typer.Option(metavar="S", min=0.05, max=3600.0, help="With --watch: how often to look.")
    ] = 1.0,
    seed: Seed = 0,
    jobs: Jobs = 1,
    as_json: Json = False,
    method: Method = MethodName.default,
    detector: Detector = None,
    descriptor: Descriptor = None,
    alpha: Alpha = None,
    scale: Scale = None,
    ratio: Ratio = None,
    tolerance_px: TolerancePx = None,
    trials: Trials = None,
    confidence: Confidence = None,
    common_cell: CommonCellOption = None,
) -> None:
    """Fuse maps of unknown relative poses, one global map for each group that hangs together.

    Writes global_0.yaml/.pgm/.npz/.png, global_1 and so on, and report.json: groups, the pose of each map with its
    covariance, and each pair, also those withdrawn since they contradict others. A group's frame is that of its map
    with the most known area. Where a robot's trajectory lies beside its map (trajectory.tum of run and replay, or
    NAME.tum), global_0_NAME.tum is where it drove in the global map, and the picture and the report show where it is.
    Interrupted, the same command with the same -o goes on: finished pairs are kept there in pairs.jsonl. --method
    thesis merges in levels, which tree.png shows (figure 5.6). Exit code 3: more than one group, as far as can be told,
    or a map or a trajectory was skipped, since it cannot be read, or the map has no known cell.

    With --watch two robots' maps are merged once they were registered at one place in three versions in a row, each
    sure by itself and with more wall that agrees; a merge that a later version contradicts is withdrawn. The results
    are written anew at each change.
    A map that vanishes or turns unreadable is named and its last good version kept; what a robot mapped before it
    started again is kept as a map of its own.
    """
    from tools.group_fusion import fuse_maps
    from tools.map_watch import watch_maps
    from tools.pair_registration import Registration
    from tools.robot_poses import robot_lines
    from tools.signals import stop_on_signals

    settings = thesis_settings(
        method,
        detector=detector,
        descriptor=descriptor,
        alpha=alpha,
        scale=scale,
        ratio=ratio,
        tolerance_px=tolerance_px,
        trials=trials,
        confidence=confidence,
        common_cell=common_cell,
    )
    registration = Registration(method.value, settings, seed)
    if watch:
        if method is not MethodName.default:
            raise UsageError("--watch: goes with the default method only: --method thesis is for finished maps")
        with stop_on_signals() as stop:
            folder, report = watch_maps(maps, output, registration, jobs, every_s=every, stop=stop)
    else:
        folder, report = fuse_maps(maps, output, registration, jobs)
    if as_json:
        print_json(report)
    else:
        for line in (*_pair_lines(report), *_map_lines(report), *robot_lines(report["robots"])):
            typer.echo(line)
        count = len(report["groups"])
        if len(report["maps"]) == 1:
            typer.echo("one map: nothing to fuse it with, so this is a copy")
        typer.echo(f"{folder}: report.json and {count or 'no'} global map{'' if count == 1 else 's'}")
    groups = {entry["group"] for entry in (*report["maps"], *report["robots"])}
    raise typer.Exit(ExitCode.OK if groups == {0} else ExitCode.PARTIAL)


def _pair_lines(report: dict[str, Any]) -> list[str]:
    """Return what was decided: the pairs, where they are few, and else those that were fused or withdrawn."""
    two = len(report["maps"]) == 2
    lines = []
    for pair in report["pairs"]:
        verdict = "fused" if pair["accepted"] else "withdrawn" if pair["withdrawn"] else "not fused"
        if two:
            lines.append(f"{verdict}: {pair['reason']}")
        elif verdict != "not fused":
            lines.append(f"{verdict}: {pair['a']} with {pair['b']}: {pair['reason']}")
    for tree in report.get("trees", []):
        lines += tree
    made = report["registrations"]
    if not two and made["all_pairs"]:
        lines.append(
            f"{made['registered']} pairs registered, {made['from_cache']} taken from an earlier run; all pairs would be"
            f" {made['all_pairs']}; {report['seconds']:.1f} s"
        )
    return lines


def _map_lines(report: dict[str, Any]) -> list[str]:
    """Return where each map is."""
    lines = []
    for entry in report["maps"]:
        where = "skipped" if entry["group"] is None else f"in global_{entry['group']}"
        if "same_as" in entry:
            where += f", the same map as {entry['same_as']}"
        elif "counted_within" in entry:
            where += f", all within {entry['counted_within']}"
        lines.append(f"  {entry['file']}: {where}")
    return lines
