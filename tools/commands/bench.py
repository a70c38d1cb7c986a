"""`mapfuse-robot bench`: speed and memory, beside a bound."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tools.commands.options import ConfigFile, Json, load_config, print_json


def bench(
    recording: Annotated[
        Path, typer.Argument(metavar="FILE", help="A recording: MCAP, .db3, or the folder of a ROS 2 bag.")
    ],
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Measure decoding and mapping on a recording, beside the lidar's own pace.

    Times are wall-clock time on this machine as it is now; close other programs for a figure to quote.
    """
    from dataclasses import asdict

    from drivers.recording_reader import open_recording
    from tools.bench import bench_recording
    from tools.replay_run import recorded_config

    with open_recording(recording) as opened:
        report = bench_recording(opened, load_config(config_file) if config_file else recorded_config(opened))
        simulated = opened.metadata.get("mapfuse.origin", {}).get("simulated") == "true"
    if as_json:
        print_json({"simulated": simulated, **asdict(report)})
        return
    label = "simulated" if simulated else "not marked as simulated"
    typer.echo(f"mapfuse-robot bench {recording}  ({label}; {report.scans} scans)")
    typer.echo("  ms a turn            median     p95     max")
    for stage in report.stages:
        typer.echo(f"  {stage.stage:<18} {stage.median_ms:>8.2f} {stage.p95_ms:>7.2f} {stage.max_ms:>7.2f}")
    typer.echo(f"  bound: a turn      {report.turn_ms:>8.2f}")
    typer.echo(f"  {report.real_time_factor:.0f} x real time, peak memory {report.peak_memory_mb:.0f} MB")
