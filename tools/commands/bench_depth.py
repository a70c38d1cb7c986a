"""`mapfuse-robot bench depth`: what a depth camera costs, by stage."""

from __future__ import annotations

from typing import Annotated

import typer

from tools.commands.options import ConfigFile, Json, finite, load_config, print_json


def depth(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.5, max=600.0, callback=finite, help="How long the camera streams.")
    ] = 10.0,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Measure an emulated depth camera through driver, projection, scan and grid, at its own pace.

    Frames are rendered beforehand. Open3D's projection is measured beside numpy's where it can be loaded, each in a
    process of its own. SIMULATED frames; close other programs for figures to quote.
    """
    from dataclasses import asdict

    from tools.depth_bench import STAGES, bench_depth, projections
    from tools.own_process import in_own_process

    config = load_config(config_file)
    costs = [in_own_process(bench_depth, name, config, seconds) for name in projections()]
    section = config.depth
    mode = f"{section.width}x{section.height} at {section.fps} Hz"
    if as_json:
        print_json({"simulated": True, "mode": mode, "costs": [asdict(cost) for cost in costs]})
        return
    typer.echo(f"mapfuse-robot bench depth --seconds {seconds:g}  (simulated, {mode})")
    for cost in costs:
        rate = cost.frames / cost.seconds
        typer.echo(
            f"projection by {cost.projection}: {cost.frames} frames, {rate:.1f} a second, {cost.lost_frames} lost"
        )
        typer.echo("  stage        CPU of a core   ms a frame")
        for stage in STAGES:
            typer.echo(f"  {stage:<12} {cost.cpu_share[stage]:>12.1%} {cost.cpu_ms[stage]:>12.2f}")
        typer.echo(f"  {'all':<12} {sum(cost.cpu_share.values()):>12.1%} {sum(cost.cpu_ms.values()):>12.2f}")
        spread = cost.latency_ms
        typer.echo(
            f"  frame to grid: median {spread.median:.1f} ms, p99 {spread.p99:.1f} ms, most {spread.max:.1f} ms;"
            f" memory {cost.peak_mb:.0f} MB"
        )
    if len(costs) == 1:
        typer.echo("Open3D cannot be loaded here: not measured")
