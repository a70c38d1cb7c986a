"""The demo: two emulated cars are mapped live, their maps fused, and a third car's camera map; a path; all scored."""

from __future__ import annotations

import json
import logging
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.map_io import read_map
from mapping.trajectory import read_tum
from tools.demo_camera import camera_line, fuse_with_camera, map_with_camera
from tools.demo_cars import CarFiles, DemoCar, Stopped, drive_live, run_command
from tools.demo_scores import MappedCar, read_car, score_alignment, score_car, score_common
from tools.errors import ToolError
from tools.exit_codes import ExitCode
from tools.results import Report
from tools.signals import stop_on_signals

if TYPE_CHECKING:
    from tools.plots import PlacedMaps

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)
CARS = (DemoCar("A", "A2M8", "wings-west", 0.04), DemoCar("B", "A2M12", "wings-east", 0.05, motor_pwm=792))
_MARK = "demo.json"  # tells a folder that a former demo made, which may be emptied


def run_demo(folder: Path, seed: int) -> Report | None:
    """Run the mission, write the picture and demo.json, and return what that holds; None if the user ended it.

    Raises ToolError naming the part that failed.
    """
    started = time.monotonic()
    _clear(folder)
    files = [CarFiles(folder / f"car_{car.name.lower()}") for car in CARS]
    for each in files:
        each.folder.mkdir()
    with stop_on_signals() as stop:
        try:
            report = _mission(folder, files, seed, stop.is_set)
        except KeyboardInterrupt:
            return None
    report["seconds"] = round(time.monotonic() - started, 1)
    (folder / _MARK).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return report


def exit_code_of(report: Report) -> ExitCode:
    """Return OK, or PARTIAL where the maps were not fused; raises ToolError for a replay that differs or no path."""
    if not all(car["identical"] for car in report["cars"]):
        raise ToolError("a replay differs from its live run, though no scan was dropped: please report this")
    if not (report["alignment"]["accepted"] and report["camera"]["accepted"]):
        return ExitCode.PARTIAL
    if not report["plan"]["solved"]:
        raise ToolError(f"no path from car A's start to car B's was found: {report['plan']['error']}")
    return ExitCode.OK


def _mission(folder: Path, files: list[CarFiles], seed: int, stopped: Stopped) -> Report:
    log.info("1/6  two emulated cars with RPLIDARs set out (simulated data)")
    emitted = drive_live(list(zip(CARS, files, strict=True)), seed, stopped, log.info)
    log.info("2/6  both recordings are replayed")
    for each in files:
        run_command(stopped, "-q", "replay", str(each.live / "recording.mcap"), "-o", str(each.replay))
    log.info("3/6  their maps are fused, without a hint where they are: mapfuse-robot fuse")
    maps = [str(each.live / "map.npz") for each in files]
    arguments = ["fuse", *maps, "-o", str(folder / "fused"), "--seed", str(seed)]
    run_command(stopped, *arguments, allowed=(ExitCode.OK, ExitCode.PARTIAL))
    fused: Report = json.loads((folder / "fused/report.json").read_text(encoding="utf-8"))
    log.info(
        "4/6  a third car with a depth camera and wheels; its map is fused with car A's (simulated, not in real time)"
    )
    camera = map_with_camera(folder / "car_c", seed, stopped)
    log.info("5/6  a path from where car A started to where car B started: mapfuse-robot plan")
    planned = _plan(folder, files, fused, seed, stopped)
    log.info("6/6  all is scored against the simulator's truth")
    mapped = [read_car(car, each) for car, each in zip(CARS, files, strict=True)]
    a, b = mapped
    report: Report = {
        "simulated": True,
        "seed": seed,
        "cars": [score_car(each, result, count) for each, result, count in zip(mapped, files, emitted, strict=True)],
        "common": score_common(a, b),
        "alignment": score_alignment(a, b, fused["pairs"][0]),
        "camera": fuse_with_camera(folder / "car_c", a, files[0].live / "map.npz", camera, seed, stopped),
        "plan": {key: planned[key] for key in ("solved", "error", "length_m", "seconds", "min_clearance_m")},
    }
    _draw(folder, mapped, camera, fused, planned, report)
    return report


def _plan(folder: Path, files: list[CarFiles], fused: Report, seed: int, stopped: Stopped) -> Report:
    """Plan on the first global map from car A's start to car B's; if they were not fused there is no such path."""
    a, b = fused["maps"]
    if a["group"] != b["group"]:
        return {
            "solved": False,
            "error": "NOT_FUSED",
            "length_m": None,
            "seconds": 0.0,
            "min_clearance_m": None,
            "path": [],
        }
    first_poses = [read_tum(each.live / "trajectory.tum").poses[0] for each in files]
    ends = [
        [str(value) for value in se2.compose(np.array(entry["T_global_map"]), first).tolist()]
        for entry, first in zip((a, b), first_poses, strict=True)
    ]
    command = ["plan", str(folder / "fused/global_0.npz"), "--start", *ends[0], "--goal", *ends[1]]
    options = ["--seed", str(seed), "-o", str(folder / "plan")]
    run_command(stopped, *command, *options, allowed=(ExitCode.OK, ExitCode.FAILED))
    planned: Report = json.loads((folder / "plan/plan.json").read_text(encoding="utf-8"))
    return planned


def _draw(
    folder: Path, mapped: list[MappedCar], camera: MappedCar, fused: Report, planned: Report, report: Report
) -> None:
    from tools.plots import MissionPicture, draw_mission

    together = fused["maps"][0]["group"] == fused["maps"][1]["group"]
    poses = [np.array(entry["T_global_map"]) if together else np.zeros(3) for entry in fused["maps"]]
    scored = report["alignment"]
    title = "the maps were NOT fused"
    if together:
        title = f"fused with an error of {scored['rms_m'] * 100:.1f} cm and {scored['rotation_deg']:.2f} deg"
    title += f"; common: {_common(report)}"
    T_lidar_camera = np.array(report["camera"]["T_lidar_camera"] or np.zeros(3))
    picture = MissionPicture(
        local=_placed(mapped, poses, "two local maps in the global frame"),
        fused=read_map(folder / "fused/global_0.npz"),
        path=np.array(planned["path"]).reshape(-1, 3),
        camera=_placed(
            [mapped[0], camera], [np.zeros(3), T_lidar_camera], f"camera map {camera_line(report['camera'])}"
        ),
        title=f"Simulated: {title}",
    )
    draw_mission(folder / "demo.png", picture)


def _placed(cars: list[MappedCar], poses: list[FloatArray], title: str) -> PlacedMaps:
    from tools.plots import PlacedMaps

    return PlacedMaps(
        names=tuple(f"car {each.car.name} ({each.car.model}, {each.car.resolution_m:g} m)" for each in cars),
        grids=tuple(each.grid for each in cars),
        trajectories=tuple(each.trajectory.poses for each in cars),
        T_global_map=tuple(poses),
        title=title,
    )


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
    rows.append(("common", _common(report)))
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
    rows.append(("path from A to B", path))
    rows += [("in all", f"{report['seconds']:.0f} s"), ("picture", str(folder / "demo.png"))]
    width = max(len(name) for name, _ in rows)
    return "Simulated data:\n" + "\n".join(f"  {name:<{width}}  {value}".rstrip() for name, value in rows)


def _common(report: Report) -> str:
    """Return what the two maps share, in words."""
    common = report["common"]
    return f"{common['overlap']:.0%} of the smaller map's free space, {common['wall_m']:.0f} m of wall"


def _clear(folder: Path) -> None:
    """Make the folder; empty it only if a former demo made it."""
    try:
        if folder.exists() and any(folder.iterdir()):
            if not (folder / _MARK).exists():
                raise ToolError(f"{folder}: not empty, and no former demo's folder: choose another with -o")
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _MARK).write_text("{}\n", encoding="utf-8")
    except OSError as error:
        raise ToolError(f"{folder}: no folder for the results: {error.strerror or error}: choose another") from error
