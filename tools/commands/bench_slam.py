"""`mapfuse-robot bench slam`: what SLAM costs, by stage, beside peers in the same run."""

from __future__ import annotations

import logging
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, finite, load_config, print_json
from tools.errors import UsageError

if TYPE_CHECKING:
    from tools.config import Config
    from tools.live_bench import LiveCost
    from tools.slam_bench import SlamCost
    from tools.slam_peers import PeerCost

log = logging.getLogger(__name__)


def slam(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG...", help="Recordings: MCAP, .db3, bag folders, CARMEN logs.")
    ] = None,
    relations: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="True relative poses of one of the logs: errors beside the times."),
    ] = None,
    live: Annotated[
        float,
        typer.Option(
            metavar="S", min=0.0, callback=finite, help="Also feed the first S seconds of each at their real pace."
        ),
    ] = 0.0,
    simulate: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, max=1_000_000, help="Also map N turns of a simulated A2 on a car that drives around."
        ),
    ] = 0,
    peers: Annotated[
        bool, typer.Option("--peers/--no-peers", help="Also run kiss-icp alone, and MRPT's icp-slam where installed.")
    ] = True,
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Measure SLAM on recordings: CPU time by stage, time to map over duration, memory; beside peers.

    Each measurement has a process of its own. CPU time depends little on what else runs on the computer, wall-clock
    time does: close other programs for figures to quote.
    """
    paths = list(logs or [])
    if not paths and not simulate:
        raise UsageError("name a recording, or --simulate N: there is nothing to measure")
    config = load_config(config_file) if config_file else None
    with TemporaryDirectory() as folder:
        if simulate:
            from tools.processes import in_own_process
            from tools.simulated_drive import record_round_trip

            drive = Path(folder) / f"simulated_a2m8_{simulate}_turns.mcap"
            log.info("simulating %d turns of an A2", simulate)
            in_own_process(record_round_trip, drive, simulate)
            paths.append(drive)
        reports = [_measure(path, config, tuple(relations or ()), live, peers=peers) for path in paths]
    if as_json:
        from dataclasses import asdict

        print_json(
            {
                "logs": [
                    {
                        "slam": asdict(cost),
                        "live": None if at_pace is None else asdict(at_pace),
                        "peers": [asdict(each) for each in beside],
                    }
                    for cost, at_pace, beside in reports
                ]
            }
        )
        return
    for cost, at_pace, beside in reports:
        _print_slam(cost)
        if at_pace is not None:
            _print_live(at_pace)
        if beside:
            _print_peers(cost, beside)


def _measure(
    path: Path, config: Config | None, relations: tuple[Path, ...], live_s: float, *, peers: bool
) -> tuple[SlamCost, LiveCost | None, list[PeerCost]]:
    """Measure one recording, one thing after the other, each in a fresh process."""
    from tools.live_bench import bench_live
    from tools.mrpt_peer import bench_icp_slam
    from tools.processes import in_own_process
    from tools.slam_bench import bench_slam
    from tools.slam_peers import bench_own_kiss_icp, bench_stock_kiss_icp

    log.info("%s: mapping", path)
    cost = in_own_process(bench_slam, path, config, relations)
    at_pace, beside = None, []
    if live_s:
        log.info("%s: mapping at the real pace, for up to %.0f s", path, min(live_s, cost.duration_s))
        at_pace = in_own_process(bench_live, path, config, live_s)
    if peers:
        log.info("%s: peers", path)
        beside = [
            in_own_process(bench_own_kiss_icp, path, config, relations),
            in_own_process(bench_stock_kiss_icp, path, config, relations),
            in_own_process(bench_icp_slam, path, relations),
        ]
    return cost, at_pace, beside


def _label(simulated: bool) -> str:
    return "SIMULATED" if simulated else "not marked as simulated"


def _print_slam(cost: SlamCost) -> None:
    typer.echo(
        f"{cost.log}  ({_label(cost.simulated)}; {cost.scans} scans of {cost.samples} samples every"
        f" {cost.scan_period_ms:.0f} ms, {cost.duration_s:.0f} s, {cost.length_m:.0f} m;"
        f" {cost.keyframes} keyframes, {cost.closures} closures)"
    )
    typer.echo("  stage                       CPU s   wall s   CPU ms a scan")
    for stage in cost.stages:
        typer.echo(f"  {stage.name:<26}{stage.cpu_s:>7.2f}{stage.wall_s:>9.2f}{stage.cpu_ms_per_scan:>16.3f}")
    spread = cost.scan_cpu_ms
    typer.echo(
        f"  CPU ms to map a scan: mean {spread.mean:.2f}, median {spread.median:.2f}, p99 {spread.p99:.1f},"
        f" p99.9 {spread.p999:.1f}, max {spread.max:.1f}"
    )
    typer.echo(
        f"  time to map / duration: {cost.tau_graph.cpu:.4f} CPU, {cost.tau_graph.wall:.4f} wall up to the pose graph;"
        f" {cost.tau.cpu:.4f} CPU, {cost.tau.wall:.4f} wall with refinement and grid at {cost.resolution_m:g} m"
    )
    typer.echo(
        f"  resident memory: {cost.memory_start.resident_mb:.0f} MB before the first scan,"
        f" {cost.memory_graph.resident_mb:.0f} MB after the last (peak {cost.memory_graph.peak_mb:.0f} MB),"
        f" peak {cost.refine_peak_mb:.0f} MB during the joint refinement"
    )


def _print_live(cost: LiveCost) -> None:
    spread, mapping = cost.latency_ms, cost.mapping_ms
    typer.echo(
        f"  at the real pace, searches in another thread ({_label(cost.simulated)}): {cost.mapped} of {cost.scans}"
        f" scans mapped in {cost.seconds:.0f} s, {cost.dropped} dropped, {cost.cpu_ms_per_scan:.2f} CPU ms a scan,"
        f" peak {cost.peak_mb:.0f} MB"
    )
    typer.echo("                              mean   median     p99   p99.9     max")
    for name, row in (("scan in to pose out, ms", spread), ("of that mapping, ms", mapping)):
        typer.echo(f"  {name:<26}{row.mean:>6.1f}{row.median:>9.1f}{row.p99:>8.1f}{row.p999:>8.1f}{row.max:>8.1f}")


def _print_peers(cost: SlamCost, peers: list[PeerCost]) -> None:
    from tools.slam_peers import PeerCost

    in_all_ms = sum(stage.cpu_ms_per_scan for stage in cost.stages)
    peak_mb = max(cost.memory_graph.peak_mb, cost.refine_peak_mb)
    own = PeerCost(
        "mapfuse-robot, all of it",
        "loops, refinement, grid",
        in_all_ms,
        cost.tau.cpu,
        cost.tau.wall,
        peak_mb,
        cost.score,
    )
    typer.echo("  beside                           CPU ms a scan   tau CPU  tau wall  peak MB    error m / deg note")
    for peer in (own, *peers):
        if peer.cpu_ms_per_scan is None:
            typer.echo(f"  {peer.name:<33} {peer.note}")
            continue
        score = "-" if peer.score is None else f"{peer.score.mean_m:.4f} / {peer.score.mean_deg:.3f}"
        typer.echo(
            f"  {peer.name:<33}{peer.cpu_ms_per_scan:>14.3f}{peer.tau_cpu:>10.4f}{peer.tau_wall:>10.4f}"
            f"{peer.peak_mb:>9.0f}   {score:>15} {peer.note}"
        )
