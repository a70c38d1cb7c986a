"""`mapfuse-robot bench`: speed and memory, beside a bound or peers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from tools.commands.options import ConfigFile, Json, load_config, print_json


class _RecordingOrCommand(TyperGroup):
    """Takes `bench FILE` for `bench pipeline FILE`."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first argument names, else the one that a recording is for."""
        is_command = bool(args) and self.get_command(ctx, args[0]) is not None
        return super().resolve_command(ctx, args if is_command else ["pipeline", *args])

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Leave options that are not the group's to the command: `bench --json FILE`."""
        if args and args[0].startswith("-") and args[0] not in ctx.help_option_names:
            args = ["pipeline", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_RecordingOrCommand,
    help="Measure speed and memory. `bench FILE` is short for `bench pipeline FILE`.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.callback()
def benches() -> None:
    """Measure speed and memory. `bench FILE` is short for `bench pipeline FILE`."""


@app.command()
def pipeline(
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
