"""`mapfuse-robot evaluate rates`: the thesis's maps of one log for grid resolutions and scan rates (table 4.1)."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tools.commands.options import ConfigFile, Json, load_config, print_json
from tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from tools.rate_study import RateMap

log = logging.getLogger(__name__)


def rates(
    recording: Annotated[Path, typer.Argument(metavar="LOG", help="MCAP, .db3, bag folder or CARMEN log.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for pictures and report.")],
    relations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="True relative poses of the log: their error decides as well.")
    ] = None,
    resolutions: Annotated[str, typer.Option("--cells-per-meter", metavar="R,R,...", help="Resolutions r.")] = (
        "8,12,16,20,25"
    ),
    every: Annotated[str, typer.Option("--scan-every", metavar="K,K,...", help="Rates: every k-th scan.")] = (
        "1,4,5,6,7,8"
    ),
    config_file: ConfigFile = None,
    as_json: Json = False,
) -> None:
    """Map a log at several scan rates, draw each at several resolutions, and state the time to map over duration.

    Writes maps.png (with the pose graphs, thesis fig. 4.2), tau.png (fig. 4.1) and report.json. Exit code 3: some maps
    failed; they are red, with the reason.
    """
    import json

    from drivers.recording_reader import open_recording
    from mapping.relations import read_relations
    from tools.number_lists import positive_numbers
    from tools.plots import draw_rate_maps, draw_real_time_factors
    from tools.rate_study import study_rates
    from tools.replay_run import recorded_config
    from tools.result_folder import RATES, check_result_folder, new_results
    from tools.results import writing_to

    cells = positive_numbers(resolutions, float, "--cells-per-meter")
    steps = positive_numbers(every, int, "--scan-every")
    check_result_folder(output, RATES)
    true = None if relations is None else read_relations(relations)
    with open_recording(recording) as opened:
        config = load_config(config_file) if config_file else recorded_config(opened)
        for each in cells:
            config.with_resolution(None, each)  # refuses what no grid can have
        maps = study_rates(opened, config, cells, steps, true, log.info)
        simulated = opened.metadata.get("mapfuse.origin", {}).get("simulated") == "true"
    report = {"log": str(recording), "simulated": simulated, "maps": [_row(each) for each in maps]}
    folder = new_results(output, RATES)
    title = f"{recording.name}{' (SIMULATED)' if simulated else ''}"
    with writing_to(folder):
        draw_rate_maps(folder / "maps.png", maps, f"{title}: maps and pose graphs for r and T")
        draw_real_time_factors(folder / "tau.png", maps, f"{title}: cost of a map, refined and drawn")
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if as_json:
        print_json(report)
    else:
        _print(maps, title)
    raise typer.Exit(ExitCode.PARTIAL if any(each.failures for each in maps) else ExitCode.OK)


def _row(each: RateMap) -> dict[str, object]:
    """Return a map's figures for JSON."""
    rows, cols = each.map_size
    return {
        "cells_per_meter": each.cells_per_meter,
        "scan_every": each.scan_every,
        "rate_hz": round(each.rate_hz, 4),
        "scans": each.scans,
        "rows": rows,
        "cols": cols,
        "tau_cpu": round(each.tau, 6),
        "tau_wall": round(each.tau_wall, 6),
        "agreement": round(each.agreement, 4) if each.agreement == each.agreement else None,
        "error_m": None if each.error_m is None else round(each.error_m, 4),
        "error_deg": None if each.error_deg is None else round(each.error_deg, 3),
        "failures": list(each.failures),
    }


def _print(maps: list[RateMap], title: str) -> None:
    """Print table 4.1 with the cost of each map."""
    typer.echo(title)
    typer.echo("  T Hz  one in   r   rows x cols  scans  tau CPU  tau wall  on walls   error m / deg")
    for each in maps:
        rows, cols = each.map_size
        error = "-" if each.error_m is None or each.error_deg is None else f"{each.error_m:.4f} / {each.error_deg:.2f}"
        failed = f"  FAILED: {', '.join(each.failures)}" if each.failures else ""
        typer.echo(
            f"{each.rate_hz:6.2f}{each.scan_every:8d}{each.cells_per_meter:4g}{rows:7d} x{cols:5d}{each.scans:7d}"
            f"{each.tau:9.4f}{each.tau_wall:10.4f}{each.agreement:10.1%}{error:>16}{failed}"
        )
