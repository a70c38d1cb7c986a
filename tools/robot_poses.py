"""Where the robots are in a fused map: their trajectories, found beside their maps, in the frame of the group's map."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.map_graph import carried_covariance
from mapping import se2
from mapping.errors import TrajectoryError
from mapping.trajectory import Trajectory, read_tum, write_tum
from tools.errors import ToolError
from tools.map_data_set import LIST_NAME, read_data_set
from tools.map_names import DRIVE_MAPS, distinct, map_title, plain
from tools.results import FloatArray, Report

log = logging.getLogger(__name__)
DRIVE_TRACK = "trajectory.tum"  # of `run` and `replay`
_FUSED_MAP = re.compile(r"global_\d+")


@dataclass(frozen=True, slots=True, eq=False)
class RobotTrack:
    """A robot, the number of the map file in whose frame its trajectory is, and that; None where it is unreadable."""

    robot: str
    number: int
    file: Path
    trajectory: Trajectory | None
    skipped: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlacedRobot:
    """A robot's trajectory in the frame of the global map of group k, and the covariance (3, 3) of its last pose.

    The covariance is that of the map's pose in the group, carried to where the robot is: how well the robot knows its
    place in its own map is not in it. None where the method does not tell.
    """

    track: RobotTrack
    group: int
    trajectory: Trajectory
    covariance: FloatArray | None

    @property
    def file_name(self) -> str:
        """What `fuse` calls the file of its poses."""
        return f"global_{self.group}_{self.track.robot}.tum"


@dataclass(frozen=True, slots=True, eq=False)
class FoundRobots:
    """All robots of some maps, and those of them, by their names, whose trajectory is readable."""

    tracks: Sequence[RobotTrack]
    placed: Mapping[str, PlacedRobot]

    def report(self, files: Sequence[Path]) -> list[Report]:
        """Return what the report says of each robot, of maps in these files: the last pose is the current one."""
        entries = []
        for track in self.tracks:
            entry: Report = {
                "robot": track.robot,
                "map": str(files[track.number]),
                "trajectory": str(track.file),
                "group": None,
                "poses": None,
                "stamp_s": None,
                "T_global_robot": None,
                "covariance": None,
            }
            placed = self.placed.get(track.robot)
            if placed is None:
                entry["skipped"] = track.skipped
            else:
                entry["group"], entry["poses"] = placed.group, placed.file_name
                entry["stamp_s"] = int(placed.trajectory.stamps_ns[-1]) * 1e-9
                entry["T_global_robot"] = placed.trajectory.poses[-1].tolist()
                entry["covariance"] = None if placed.covariance is None else placed.covariance.tolist()
            entries.append(entry)
        return entries


def find_tracks(files: Mapping[int, Path]) -> list[RobotTrack]:
    """Read the trajectories of map files, by their numbers: those that a set.json names, else those beside the maps.

    One that several files have counts for the first of them. Unreadable ones are told.
    """
    listed = _listed({file.resolve().parent for file in files.values()})
    found: dict[Path, tuple[int, Path]] = {}
    for number, file in sorted(files.items()):
        named = listed.get(file.resolve())
        for track in tracks_beside(file) if named is None else [named[0]]:
            found.setdefault(track.resolve(), (number, track))
    called = {number: named[1] for number, file in files.items() if (named := listed.get(file.resolve())) is not None}
    names = _names([(files[number], track, called.get(number, "")) for number, track in found.values()])
    tracks = []
    for (number, path), name in zip(found.values(), names, strict=True):
        try:
            tracks.append(RobotTrack(name, number, path, read_tum(path)))
        except TrajectoryError as error:
            log.warning("%s: skipped", error)
            tracks.append(RobotTrack(name, number, path, None, str(error)))
    return tracks


def tracks_beside(map_file: Path) -> list[Path]:
    """Return the trajectories in the frame of a map that lie beside its file.

    Of NAME.yaml or .npz that is NAME.tum, else of what `run` and `replay` write trajectory.tum; of a global_<k> of
    `fuse` all its robots'.
    """
    own = map_file.with_suffix(".tum")
    if own.is_file():
        return [own]
    if map_file.stem in DRIVE_MAPS and (map_file.parent / DRIVE_TRACK).is_file():
        return [map_file.parent / DRIVE_TRACK]
    if _FUSED_MAP.fullmatch(map_file.stem):
        return sorted(map_file.parent.glob(f"{map_file.stem}_*.tum"))
    return []


def _listed(folders: set[Path]) -> dict[Path, tuple[Path, str]]:
    """Return trajectory and robot, by the map, that data sets name in whose folders, or one below, the maps lie."""
    tracks: dict[Path, tuple[Path, str]] = {}
    for folder in sorted({*folders, *(folder.parent for folder in folders)}):
        if not (folder / LIST_NAME).is_file():
            continue
        try:
            maps = read_data_set(folder).maps
        except ToolError as error:
            log.warning("%s; it names no trajectory", error)
            continue
        for each in maps:
            if each.trajectory is not None:
                tracks[each.path.resolve()] = each.trajectory, each.robot
    return tracks


def place(
    track: RobotTrack, group: int, poses: tuple[FloatArray, FloatArray], covariance: FloatArray | None
) -> PlacedRobot:
    """Return a readable track in its group's frame.

    poses: T_group_map (3,) of the map, whose covariance (3, 3) is given, and T_group_file (3,) of the file that the
    track belongs to; these differ where a map has two files with two frames.
    """
    assert track.trajectory is not None, "unreadable tracks have no place"
    T_group_map, T_group_file = poses
    placed = Trajectory(track.trajectory.stamps_ns, se2.compose(T_group_file, track.trajectory.poses))
    if covariance is not None:
        covariance = carried_covariance(T_group_map, covariance, se2.between(T_group_map, placed.poses[-1]))
    return PlacedRobot(track, group, placed, covariance)


def write_poses(folder: Path, robots: Iterable[PlacedRobot]) -> None:
    """Write a TUM file for each robot."""
    for robot in robots:
        partial = folder / f"{robot.file_name}.part"
        write_tum(partial, robot.trajectory)
        partial.replace(folder / robot.file_name)


def robot_lines(entries: Iterable[Report]) -> list[str]:
    """Return a line for each robot of the report: where it is."""
    lines = []
    for entry in entries:
        if entry["group"] is None:
            lines.append(f"  robot {entry['robot']}: skipped")
            continue
        x, y, yaw = entry["T_global_robot"]
        where = f"{x:.2f} m, {y:.2f} m, {math.degrees(yaw):.1f} deg in global_{entry['group']}"
        if entry["covariance"] is not None:
            off_m, off_rad = deviation(np.array(entry["covariance"]))
            uncertain = f"its map +- {off_m:.3f} m, {math.degrees(off_rad):.2f} deg"
            where += f" ({uncertain if off_m or off_rad else 'whose frame is that of its map'})"
        lines.append(f"  robot {entry['robot']}: {where}: {entry['poses']}")
    return lines


def deviation(covariance: FloatArray) -> tuple[float, float]:
    """Return one standard deviation of a pose (covariance (3, 3)): in m, where it is least certain, and in rad."""
    largest = float(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    return math.sqrt(max(largest, 0.0)), math.sqrt(max(float(covariance[2, 2]), 0.0))


def _names(places: Sequence[tuple[Path, Path, str]]) -> list[str]:
    """Return a name for each map file, track and robot as a data set calls it, "" for none.

    Without that it is the map's; of a robot in a fused map that of its track.
    """
    short, long = [], []
    for map_file, track, robot in places:
        fused = _FUSED_MAP.fullmatch(map_file.stem) and track.stem.startswith(f"{map_file.stem}_")
        name = track.stem.removeprefix(f"{map_file.stem}_") if fused else map_file.stem
        short.append(plain(robot) if robot else plain(name) if fused else map_title(map_file))
        long.append(f"{map_file.resolve().parent.name}-{name}")
    return distinct(short, long)
