"""The last part of the demo: an emulated car drives on the fused map, live, to where another one started; scored."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.trajectory import Trajectory, read_tum
from tools.demo_processes import PATIENCE_S, Stopped, command_processes
from tools.drive_scores import arrival
from tools.errors import ToolError
from tools.exit_codes import ExitCode
from tools.results import Report

FloatArray = NDArray[np.float64]
_ARRIVED_M = 0.15  # 0.10 m of driving, and what the maps are fused with
_MOVED_M = 0.005  # between two poses of the truth
_SETTINGS = "slam: {refine: false}\n"  # nobody needs the map of this drive


@dataclass(frozen=True, slots=True, eq=False)
class DriveWanted:
    """From a place to a goal of a map (3,), in a world; in_world (3,): where the car really stands at the beginning."""

    start: FloatArray
    goal: FloatArray
    world: str
    in_world: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class DriveOutcome:
    """How it ended: the exit code of `run`, the true drive in the world, and how often a wall stopped the car."""

    code: int
    truth: Trajectory
    contacts: int


def drive_to_goal(
    folder: Path, map_file: Path, wanted: DriveWanted, seed: int, stopped: Stopped, say: Callable[[str], None]
) -> DriveOutcome:
    """Emulate a car and let `run` drive it on a map; results in folder, which is made.

    Raises ToolError where a process failed or the drive takes too long, KeyboardInterrupt if stopped() says so.
    """
    folder.mkdir()
    link, truth, config = folder / "lidar", folder / "truth.tum", folder / "config.yaml"
    pose = [f"{value:.6f}" for value in wanted.in_world]
    emulate = ["emulate", "car", "--world", wanted.world, "--pose", *pose, "--lidar-link", str(link)]
    emulate += ["--rover", "udp:127.0.0.1:0", "--truth", str(truth), "--seed", str(seed), "--json"]
    with command_processes() as start:
        emulator = start("emulate car", emulate)
        ready = emulator.event("ready", PATIENCE_S, (), stopped)
        ends = {"--start": wanted.start, "--goal": wanted.goal}
        options = ["--lidar", str(link), "--vehicle", str(ready["vehicle"]), "--map", str(map_file)]
        options += [word for name, pose in ends.items() for word in (name, *(f"{value:.3f}" for value in pose))]
        config.write_text(_SETTINGS, encoding="utf-8")
        options += ["--config", str(config), "-o", str(folder / "live")]
        say(f"     mapfuse-robot run {shlex.join(options)}")
        run = start("run", ["-q", "run", *options])
        code = run.wait(PATIENCE_S, stopped)
        if code not in (ExitCode.OK, ExitCode.PARTIAL):
            raise ToolError(f"run failed with exit code {code} while it drove: see above")
        emulator.interrupt()
        contacts = int(str(emulator.event("stopped", PATIENCE_S, (), stopped)["contacts"]))
        emulator.wait(PATIENCE_S, stopped)
    return DriveOutcome(code, read_tum(truth), contacts)


def score_drive(outcome: DriveOutcome, goal_in_world: FloatArray) -> Report:
    """Return how far from a true pose (3,) the car really stood at the end, and how it got there."""
    poses = outcome.truth.poses
    end = arrival(poses[-1], goal_in_world)
    moving = np.flatnonzero(np.hypot(*np.diff(poses[:, :2], axis=0).T) > _MOVED_M)
    seconds = 0.0
    if len(moving):
        seconds = float(outcome.truth.stamps_ns[moving[-1] + 1] - outcome.truth.stamps_ns[moving[0]]) * 1e-9
    return {
        "arrived": outcome.code == ExitCode.OK and end.is_within(_ARRIVED_M),
        "exit_code": int(outcome.code),
        "away_m": round(end.away_m, 4),
        "turned_deg": round(float(np.degrees(end.turned_rad)), 2),
        "contacts": outcome.contacts,
        "driven_m": round(outcome.truth.length_m, 2),
        "driven_s": round(seconds, 1),
    }


def drive_line(scored: Report) -> str:
    """Return the score in words."""
    if scored["exit_code"] != ExitCode.OK:
        return f"did NOT arrive, {scored['away_m']:.2f} m away after {scored['driven_m']:.1f} m"
    contacts = "no contact" if scored["contacts"] == 0 else f"{scored['contacts']} CONTACTS"
    way = f"{scored['driven_m']:.1f} m in {scored['driven_s']:.0f} s"
    return f"{way}, {scored['away_m'] * 100:.1f} cm and {scored['turned_deg']:.1f} deg off, {contacts}"
