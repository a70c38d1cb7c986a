"""The results of the demo for people: a table, and what two maps share in words."""

from __future__ import annotations

from pathlib import Path

from tools.demo_camera import camera_line
from tools.demo_drive import drive_line
from tools.results import Report


def table(folder: Path, report: Report) -> str:
    """Return the report as a table for people."""
    rows: list[tuple[str, str]] = []
    for car in report["cars"]:
        same = "identical" if car["identical"] else "DIFFERENT"
        scans = f"{car['mapped_scans']} scans mapped, {car['dropped_scans']} dropped"
        pace = f"{car['scans_hz']:.0f} turns a second"
        rows += [
            (f"car {car['name']}", f"{car['model']}, {pace}, map of {car['resolution_m']:g} m cells"),
            ("", f"{car['driven_m']:.1f} m in {car['driven_s']:.0f} s, {scans}"),
            ("", f"{car['decoded']} of {car['emitted']} points decoded ({car['decoded'] / car['emitted']:.2%})"),
            ("", f"trajectory error {car['rms_m'] * 100:.1f} cm rms, replay and live run {same}"),
        ]
    rows.append(("common", common_line(report)))
    scored, planned = report["alignment"], report["plan"]
    rows.append(("frames apart", f"{scored['frames_apart_m']:.1f} m, {scored['frames_apart_deg']:.0f} deg"))
    verdict = "fused" if scored["accepted"] else "REFUSED"
    error = (
        "" if scored["rms_m"] is None else f", error {scored['rms_m'] * 100:.1f} cm, {scored['rotation_deg']:.2f} deg"
    )
    rows.append(("alignment", f"{verdict} in {scored['seconds']:.1f} s{error}"))
    seen = report["camera"]
    rows.append(("camera map", camera_line(seen)))
    rows.append(("", f"car C, {seen['driven_m']:.1f} m, trajectory error {seen['trajectory_rms_m'] * 100:.1f} cm rms"))
    path = f"none: {planned['error']}"
    if planned["solved"]:
        path = f"{planned['length_m']:.1f} m, found in {planned['seconds']:.2f} s"
    rows.append(("path", f"{path}, from where car A stands to where car B started" if planned["solved"] else path))
    if report["drive"] is not None:
        rows.append(("car A drives it", drive_line(report["drive"])))
    rows += [("in all", f"{report['seconds']:.0f} s"), ("picture", str(folder / "demo.png"))]
    width = max(len(name) for name, _ in rows)
    return "Simulated data:\n" + "\n".join(f"  {name:<{width}}  {value}".rstrip() for name, value in rows)


def common_line(report: Report) -> str:
    """Return what the two maps share, in words."""
    common = report["common"]
    return f"{common['overlap']:.0%} of the smaller map's free space, {common['wall_m']:.0f} m of wall"
