"""`mapfuse-robot bench depth`: what a depth camera costs, by stage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, finite, load_config, print_json

if TYPE_CHECKING:
    from tools.depth_bench import DepthCost
    from tools.depth_beside_lidar import BothCosts


def depth(
    seconds: Annotated[
        float, typer.Option(metavar="S", min=0.5, max=600.0, callback=finite, help="How long each projection streams.")
    ] = 10.0,
    lidar: Annotated[
        bool, typer.Option("--lidar/--no-lidar", help="Map an emulated lidar at 10 Hz at the same time, on two cores.")
    ] = True,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Measure an emulated depth camera through driver, projection, scan and grid, at its own pace, beside a lidar.

    Frames are rendered beforehand. Open3D's projection is measured beside numpy's where it can be loaded, each in a
    process of its own. SIMULATED sensors; close other programs for figures to quote.
    """
    from dataclasses import asdict

    from tools.depth_bench import bench_depth, projections
    from tools.depth_beside_lidar import bench_depth_beside_lidar
    from tools.processes import in_own_process

    config = load_config(config_file)
    section = config.depth
    mode = f"{section.width}x{section.height} at {section.fps} Hz"
    if not as_json:
        beside = ", beside a lidar at 10 Hz" if lidar else ", without a lidar"
        typer.echo(f"mapfuse-robot bench depth --seconds {seconds:g}  (simulated, {mode}{beside})")
    costs: list[DepthCost] = []
    both: list[BothCosts] = []
    for name in projections():
        if lidar:
            both.append(in_own_process(bench_depth_beside_lidar, name, config, seconds))
        costs.append(both[-1].depth if lidar else in_own_process(bench_depth, name, config, seconds))
        if not as_json:
            _tell_camera(costs[-1])
            if lidar:
                _tell_lidar(both[-1])
    if as_json:
        beside_lidar = [{**asdict(each.lidar), "cores": each.cores} for each in both]
        print_json({"simulated": True, "mode": mode, "costs": [asdict(cost) for cost in costs], "lidar": beside_lidar})
    elif len(costs) == 1:
        typer.echo("Open3D cannot be loaded here: not measured (make setup-depth)")


def _tell_camera(cost: DepthCost) -> None:
    rate, spread = cost.frames / cost.seconds, cost.latency_ms
    typer.echo(f"projection by {cost.projection}: {cost.frames} frames, {rate:.1f} a second, {cost.lost_frames} lost")
    typer.echo(f"  {'stage':<16} CPU of a core   ms a frame")
    for stage, share in cost.cpu_share.items():
        typer.echo(f"  {stage:<16} {share:>13.1%} {cost.cpu_ms[stage]:>12.2f}")
    typer.echo(f"  {'camera in all':<16} {sum(cost.cpu_share.values()):>13.1%} {sum(cost.cpu_ms.values()):>12.2f}")
    typer.echo(f"  frame to grid: median {spread.median:.1f} ms, p99 {spread.p99:.1f} ms, most {spread.max:.1f} ms")
    typer.echo(f"  memory: {cost.peak_mb:.0f} MB at the most, the rendered frames included")


def _tell_lidar(both: BothCosts) -> None:
    lidar, spread = both.lidar, both.lidar.latency_ms
    for name, share in (*lidar.cpu_share.items(), ("other threads", both.others_share)):
        typer.echo(f"  {name:<16} {share:>13.1%}")
    typer.echo(f"  {'whole process':<16} {both.depth.process_share:>13.1%}   of one core; it had {both.cores}")
    typer.echo(
        f"  lidar: {lidar.scans} scans mapped, {lidar.lost_scans} lost; scan to pose: median {spread.median:.1f} ms,"
    )
    typer.echo(f"  p99 {spread.p99:.1f} ms, most {spread.max:.1f} ms")
