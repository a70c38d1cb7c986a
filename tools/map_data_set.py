"""A set of maps to measure map fusion on (thesis section 4.1.1): a folder of map files and its list `set.json`."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.wording import fault_in
from mapping.errors import MapFileError
from mapping.map_io import read_map
from tools.errors import ToolError
from tools.json_values import number_or_none, relative_path
from tools.map_folder import map_files
from tools.results import writing_to

FloatArray = NDArray[np.float64]
LIST_NAME = "set.json"
_FORMAT, _VERSION = "mapfuse-map-set", 1
_MADE_BY = "name a folder that `mapfuse-robot data-set` wrote, or a folder of map files"


@dataclass(frozen=True, slots=True, eq=False)
class DataSetMap:
    """One map: a .npz or .yaml file as mapping.map_io writes it, and where it comes from.

    rate_hz: T, scans a second that it was drawn from, None unknown; scan_every: every so many scans of the drive, None
    unknown. robot: which robot, or part of the drive. step: time index of a growing map. pose: true pose (3,) in m and
    rad of the map's frame in the set's frame, None unknown. trajectory: TUM file of the robot in the map's frame.
    warp_m: rms distance by which the map itself, being bent, is off at its true pose.
    """

    name: str
    path: Path
    resolution_m: float
    rate_hz: float | None = None
    scan_every: int | None = None
    robot: str = ""
    step: int | None = None
    pose: FloatArray | None = None
    trajectory: Path | None = None
    warp_m: float = 0.0

    @property
    def cells_per_meter(self) -> float:
        """The thesis's r."""
        return 1.0 / self.resolution_m


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """A drawing of the building: an image, m a pixel, and the pose (3,) of its lower-left corner in the set's frame."""

    image: Path
    resolution_m: float | None = None
    pose: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MapDataSet:
    """Maps and one sentence on which data they are of, how cut, and whether real or simulated.

    kind: as `data-set --kind` names it, "" for a folder without a list. command: the one that made it, "" unknown.
    """

    folder: Path
    name: str
    source: str
    simulated: bool
    maps: tuple[DataSetMap, ...]
    kind: str = ""
    floor_plan: FloorPlan | None = None
    command: str = ""

    @property
    def label(self) -> str:
        """The name with the word that every table and picture of it owes its reader."""
        origin = "SIMULATED data" if self.simulated else "real data" if self.kind else "data of unknown origin"
        return f"{self.name}, {origin}"


def read_data_set(folder: Path) -> MapDataSet:
    """Read a folder with a set.json, or all maps of a folder without one, by their names; raises ToolError.

    A plain folder says of no map where it comes from; of a .yaml and an .npz of one name the .npz is taken.
    """
    path = folder / LIST_NAME
    if not folder.is_dir():
        raise ToolError(f"{folder}: no such folder: {_MADE_BY}")
    if not path.is_file():
        return _plain_folder(folder)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ToolError(f"{path}: not JSON ({fault_in(error)}): make the set anew") from error
    if not isinstance(content, dict) or content.get("format") != _FORMAT or content.get("version") != _VERSION:
        raise ToolError(f"{path}: not a map data set: expected format {_FORMAT}, version {_VERSION}")
    try:
        maps = tuple(_map_of(entry, folder) for entry in content["maps"])
        plan = content["floor_plan"]
        floor_plan = (
            None
            if plan is None
            else FloorPlan(folder / plan["image"], number_or_none(plan["resolution_m"]), _pose(plan["pose"]))
        )
        text = {key: str(content[key]) for key in ("name", "source", "kind", "command")}
        simulated = content["simulated"]
        if not isinstance(simulated, bool):
            raise TypeError(f"simulated is {simulated!r}, expected true or false")
    except (KeyError, TypeError, ValueError) as error:
        raise ToolError(f"{path}: not whole: {fault_in(error)}: make the set anew") from error
    missing = [each.path for each in maps if not each.path.is_file()]
    if missing or not maps:
        raise ToolError(f"{missing[0] if missing else path}: {'no such file' if missing else 'no maps'}: make it anew")
    return MapDataSet(folder, text["name"], text["source"], simulated, maps, text["kind"], floor_plan, text["command"])


def write_data_set(data: MapDataSet) -> None:
    """Write set.json into the set's folder, whole or not at all; all files lie below it. Raises ToolError."""
    plan = data.floor_plan
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "name": data.name,
        "kind": data.kind,
        "source": data.source,
        "simulated": data.simulated,
        "command": data.command,
        "floor_plan": None
        if plan is None
        else {
            "image": relative_path(plan.image, data.folder),
            "resolution_m": plan.resolution_m,
            "pose": None if plan.pose is None else plan.pose.tolist(),
        },
        "maps": [_entry_of(each, data.folder) for each in data.maps],
    }
    path = data.folder / LIST_NAME
    partial = path.with_name(f"{path.name}.part")
    with writing_to(path):
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        partial.replace(path)


def data_hash(data: MapDataSet) -> str:
    """Return a hash of the maps' files and of what the list says of each."""
    digest = hashlib.sha256()
    for each in data.maps:
        digest.update(f"{each.name} {each.rate_hz} {each.robot} {each.step} {each.pose} {each.scan_every}".encode())
        try:
            digest.update(each.path.read_bytes())
        except OSError as error:
            raise ToolError(
                f"{each.path}: cannot read the map: {error.strerror or error}: make the set anew"
            ) from error
    return digest.hexdigest()


def _plain_folder(folder: Path) -> MapDataSet:
    files = {path.stem: path for path in map_files(folder.iterdir())}
    try:
        maps = tuple(DataSetMap(stem, files[stem], read_map(files[stem]).resolution_m) for stem in sorted(files))
    except MapFileError as error:
        raise ToolError(str(error)) from error
    if not maps:
        raise ToolError(f"{folder}: neither a {LIST_NAME} nor a map (.yaml, .npz) in it: {_MADE_BY}")
    name = folder.resolve().name
    return MapDataSet(folder, name, f"The maps of the folder {name}; where they are from is not known.", False, maps)


def _map_of(entry: dict[str, Any], folder: Path) -> DataSetMap:
    resolution_m = number_or_none(entry["resolution_m"])
    if resolution_m is None or resolution_m <= 0.0:
        raise ValueError(f"resolution_m {entry['resolution_m']!r}, expected a positive number")
    scan_every, step, trajectory = entry["scan_every"], entry["step"], entry["trajectory"]
    return DataSetMap(
        name=str(entry["name"]),
        path=folder / entry["map"],
        resolution_m=resolution_m,
        rate_hz=number_or_none(entry["rate_hz"]),
        scan_every=None if scan_every is None else int(scan_every),
        robot=str(entry["robot"]),
        step=None if step is None else int(step),
        pose=_pose(entry["pose"]),
        trajectory=None if trajectory is None else folder / trajectory,
        warp_m=number_or_none(entry.get("warp_m")) or 0.0,
    )


def _entry_of(each: DataSetMap, folder: Path) -> dict[str, Any]:
    return {
        "name": each.name,
        "map": relative_path(each.path, folder),
        "resolution_m": each.resolution_m,
        "rate_hz": each.rate_hz,
        "scan_every": each.scan_every,
        "robot": each.robot,
        "step": each.step,
        "pose": None if each.pose is None else each.pose.tolist(),
        "trajectory": None if each.trajectory is None else relative_path(each.trajectory, folder),
        "warp_m": each.warp_m,
    }


def _pose(value: object) -> FloatArray | None:
    if value is None:
        return None
    pose = np.array(value, dtype=np.float64)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise ValueError(f"pose {value!r}, expected x, y, yaw or null")
    return pose
