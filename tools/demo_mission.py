"""The demo: two emulated cars map live, their maps are fused, one drives on the fused map; a camera's map; scores."""

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
from tools.demo_camera import camera_line, fuse_with_camera, map_with_camera
from tools.demo_cars import CARS, CarFiles, MapLive, drive_live, explore_live
from tools.demo_drive import DriveOutcome, DriveWanted, drive_line, drive_to_goal, score_drive
from tools.demo_processes import Stopped, run_command
from tools.demo_scores import MappedCar, read_car, score_alignment, score_car, score_common
from tools.demo_table import common_line
from tools.errors import ToolError
from tools.exit_codes import ExitCode
from tools.results import Report
from tools.signals import stop_on_signals
from tools.world import TOURS

if TYPE_CHECKING:
    from tools.plots import PlacedMaps

FloatArray = NDArray[np.float64]
log = logging.getLogger(__name__)
_MARK = "demo.json"  # tells a folder that a former demo made, which may be emptied


def run_demo(folder: Path, seed: int, *, explore: bool = False) -> Report | None:
    """Run the mission, write the picture and demo.json, and return what that holds; None if the user ended it.

    explore: the cars drive themselves while they map. Raises ToolError naming the part that failed.
    """
    started = time.monotonic()
    _clear(folder)
    files = [CarFiles(folder / f"car_{car.name.lower()}") for car in CARS]
    for each in files:
        each.folder.mkdir()
    with stop_on_signals() as stop:
        try:
            report = _mission(folder, files, seed, explore_live if explore else drive_live, stop.is_set)
        except KeyboardInterrupt:
            return None
    report["seconds"] = round(time.monotonic() - started, 1)
    (folder / _MARK).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return report


def exit_code_of(report: Report) -> ExitCode:
    """Return OK, or PARTIAL where the maps were not fused.

    Raises ToolError for a replay that differs, no path, or a drive that touched something or did not arrive.
    """
    if not all(car["identical"] or car["dropped_scans"] for car in report["cars"]):
        raise ToolError("a replay differs from its live run, though no scan was dropped: please report this")
    if not (report["alignment"]["accepted"] and report["camera"]["accepted"]):
        return ExitCode.PARTIAL
    if not report["plan"]["solved"]:
        raise ToolError(f"no path from car A to where car B started was found: {report['plan']['error']}")
    drive = report["drive"]
    if not drive["arrived"] or drive["contacts"]:
        raise ToolError(f"car A on the fused map: {drive_line(drive)}")
    return ExitCode.OK


def _mission(folder: Path, files: list[CarFiles], seed: int, map_live: MapLive, stopped: Stopped) -> Report:
    log.info("1/7  two emulated cars with RPLIDARs set out (simulated data)")
    emitted = map_live(list(zip(CARS, files, strict=True)), seed, stopped, log.info)
    log.info("2/7  both recordings are replayed")
    for each in files:
        run_command(stopped, "-q", "replay", str(each.live / "recording.mcap"), "-o", str(each.replay))
    log.info("3/7  their maps are fused, without a hint where they are: mapfuse-robot fuse")
    maps = [str(each.live / "map.npz") for each in files]
    arguments = ["fuse", *maps, "-o", str(folder / "fused"), "--seed", str(seed)]
    run_command(stopped, *arguments, allowed=(ExitCode.OK, ExitCode.PARTIAL))
    fused: Report = json.loads((folder / "fused/report.json").read_text(encoding="utf-8"))
    log.info(
        "4/7  a third car with a depth camera and wheels; its map is fused with car A's (simulated, not in real time)"
    )
    camera = map_with_camera(folder / "car_c", seed, stopped)
    mapped = [read_car(car, each) for car, each in zip(CARS, files, strict=True)]
    a, b = mapped
    ends = _ends(mapped, fused)
    log.info("5/7  a path from where car A stands to where car B started, which A has not seen: mapfuse-robot plan")
    planned = _plan(folder, ends, seed, stopped)
    driven, scored = None, None
    if ends is not None and planned["solved"]:
        log.info("6/7  car A drives there on the fused map: mapfuse-robot run --map --goal (simulated, in real time)")
        driven = drive_to_goal(folder / "drive", folder / "fused/global_0.npz", ends, seed, stopped, log.info)
        scored = score_drive(driven, b.truth.poses[0])
    log.info("7/7  all is scored against the simulator's truth")
    report: Report = {
        "simulated": True,
        "seed": seed,
        "explored": map_live is explore_live,
        "cars": [score_car(each, result, count) for each, result, count in zip(mapped, files, emitted, strict=True)],
        "common": score_common(a, b),
        "alignment": score_alignment(a, b, fused["pairs"][0]),
        "camera": fuse_with_camera(folder / "car_c", a, files[0].live / "map.npz", camera, seed, stopped),
        "plan": {key: planned[key] for key in ("solved", "error", "length_m", "seconds", "min_clearance_m")},
        "drive": scored,
    }
    _draw(folder, mapped, camera, fused, (planned, driven), report)
    return report


def _ends(mapped: list[MappedCar], fused: Report) -> DriveWanted | None:
    """Return the way on the first global map from where car A stopped to where car B began; None if not fused."""
    entries = fused["maps"]
    if entries[0]["group"] != entries[1]["group"]:
        return None
    a, b = mapped
    T_global_a, T_global_b = (np.array(entry["T_global_map"]) for entry in entries)
    return DriveWanted(
        start=se2.compose(T_global_a, a.trajectory.poses[-1]),
        goal=se2.compose(T_global_b, b.trajectory.poses[0]),
        world=TOURS[a.car.drive][0],
        in_world=a.truth.poses[-1],
    )


def _plan(folder: Path, wanted: DriveWanted | None, seed: int, stopped: Stopped) -> Report:
    """Plan the way; where the maps were not fused there is none."""
    if wanted is None:
        return {
            "solved": False,
            "error": "NOT_FUSED",
            "length_m": None,
            "seconds": 0.0,
            "min_clearance_m": None,
            "path": [],
        }
    ends = [[str(value) for value in pose.tolist()] for pose in (wanted.start, wanted.goal)]
    command = ["plan", str(folder / "fused/global_0.npz"), "--start", *ends[0], "--goal", *ends[1]]
    options = ["--seed", str(seed), "-o", str(folder / "plan")]
    run_command(stopped, *command, *options, allowed=(ExitCode.OK, ExitCode.FAILED))
    planned: Report = json.loads((folder / "plan/plan.json").read_text(encoding="utf-8"))
    return planned


def _draw(
    folder: Path,
    mapped: list[MappedCar],
    camera: MappedCar,
    fused: Report,
    shown: tuple[Report, DriveOutcome | None],
    report: Report,
) -> None:
    planned, driven = shown
    from tools.plots import MissionPicture, draw_mission

    together = fused["maps"][0]["group"] == fused["maps"][1]["group"]
    poses = [np.array(entry["T_global_map"]) if together else np.zeros(3) for entry in fused["maps"]]
    scored = report["alignment"]
    title = "the maps were NOT fused"
    if together:
        title = f"fused with an error of {scored['rms_m'] * 100:.1f} cm and {scored['rotation_deg']:.2f} deg"
    title += f"; common: {common_line(report)}"
    T_lidar_camera = np.array(report["camera"]["T_lidar_camera"] or np.zeros(3))
    picture = MissionPicture(
        local=_placed(mapped, poses, "two local maps in the global frame"),
        fused=read_map(folder / "fused/global_0.npz"),
        path=np.array(planned["path"]).reshape(-1, 3),
        driven=_in_global(driven, poses[0], mapped[0]),
        camera=_placed(
            [mapped[0], camera], [np.zeros(3), T_lidar_camera], f"camera map {camera_line(report['camera'])}"
        ),
        title=f"Simulated: {title}",
    )
    draw_mission(folder / "demo.png", picture)


def _in_global(driven: DriveOutcome | None, T_global_a: FloatArray, a: MappedCar) -> FloatArray:
    """Return the true drive (N, 3) in the global map, as car A's map lies in the world; empty where there is none."""
    if driven is None:
        return np.empty((0, 3))
    return se2.compose(se2.compose(T_global_a, se2.inverse(a.T_world_map)), driven.truth.poses)


def _placed(cars: list[MappedCar], poses: list[FloatArray], title: str) -> PlacedMaps:
    from tools.plots import PlacedMaps

    return PlacedMaps(
        names=tuple(f"car {each.car.name} ({each.car.model}, {each.car.resolution_m:g} m)" for each in cars),
        grids=tuple(each.grid for each in cars),
        trajectories=tuple(each.trajectory.poses for each in cars),
        T_global_map=tuple(poses),
        title=title,
    )


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
