"""`evaluate camera`: maps of a depth camera fused with maps of a lidar (thesis section 5.6), in simulated buildings.

For each seed a building, in which one car with a lidar and one with a depth camera and wheels drive and map, each from
a start of its own. The maps of one building must be fused at their true pose; each camera map is also held against the
lidar map of the next seed's building, which must be refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.alignment import Alignment
from fusion.errors import FusionError
from fusion.evaluation import alignment_error
from fusion.registration import register
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.config import Config
from tools.generated_building import two_drives
from tools.lettering import fitted, write_text
from tools.map_panels import overlay_panel
from tools.mapped_drives import CameraSetup, MappedDrive, map_by_camera, map_by_lidar
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.pictures import Image, write_picture
from tools.processes import in_processes
from tools.results import Report, save_results, writing_to

FloatArray = NDArray[np.float64]

RIGHT_M, RIGHT_DEG = 0.15, 2.0
_TILE = (300, 420)  # rows and columns of a pair in the picture
_CAPTION_PX, _COLUMNS = 26, 5
_RIGHT_BGR, _REFUSED_BGR, _WRONG_BGR = (94, 120, 0), (0, 105, 185), (50, 20, 175)


@dataclass(frozen=True, slots=True, eq=False)
class MapsOfOneBuilding:
    """What two cars made of a seed's building: map files, the true pose of the camera map's frame in the lidar map's.

    T_lidar_camera (3,) is by where each car truly was at its first mapped scan; of_drives (3,) fits both drives as a
    whole, so that the camera's own error at its start is not counted. row: what the report says of the two.
    """

    seed: int
    lidar: Path
    camera: Path
    T_lidar_camera: FloatArray
    of_drives: FloatArray
    row: Report


def evaluate_camera(
    seeds: Sequence[int],
    folder: Path,
    config: Config,
    setup: CameraSetup,
    jobs: int,
    on_progress: Callable[[str], None],
) -> Report:
    """Map all buildings, register true and wrong pairs, write maps and pairs.png to a folder; return the report."""
    made = []
    for maps in in_processes(partial(map_building, folder, config, setup), seeds, jobs=jobs):
        made.append(maps)
        on_progress(f"seed {maps.seed}: mapped, camera's drive {maps.row['camera_rms_m']:.3f} m rms off")
    rows = []
    tasks = [(maps, maps) for maps in made] + [(maps, made[(n + 1) % len(made)]) for n, maps in enumerate(made)]
    if len(made) == 1:
        tasks = tasks[:1]  # with itself a building makes no wrong pair
    for row in in_processes(registered_pair, tasks, jobs=jobs):
        rows.append(row)
        on_progress(line_of(row))
    with writing_to(folder):
        write_picture(folder / "pairs.png", _contact_sheet(rows))
    return {"simulated": True, **summary_of(rows), "rows": rows}


def map_building(folder: Path, config: Config, setup: CameraSetup, seed: int) -> MapsOfOneBuilding:
    """Drive both cars through a seed's building and save what `replay` saves, in folders of the seed's."""
    cv2.setNumThreads(1)
    site = two_drives(seed)
    lidar = map_by_lidar(site.building.world, site.drives[0], config, 2 * seed)
    camera = map_by_camera(site.building.world, site.drives[1], config, setup, 2 * seed + 1)
    files = []
    for name, drive in (("lidar", lidar), ("camera", camera)):
        place = folder / f"seed_{seed}" / name
        with writing_to(place):
            place.mkdir(parents=True, exist_ok=True)
        save_results(place, drive.flow, f"simulated building {seed}", {"simulated": True})
        files.append(place / "map.npz")
    true_pose = se2.between(lidar.T_world_map, camera.T_world_map)
    of_drives = se2.between(lidar.T_world_drive, camera.T_world_drive)
    return MapsOfOneBuilding(
        seed, files[0], files[1], true_pose, of_drives, _row_of(site.visits, lidar, camera, true_pose)
    )


def registered_pair(pair: tuple[MapsOfOneBuilding, MapsOfOneBuilding]) -> Report:
    """Register the lidar map of the second building with the camera map of the first; return the pair's row."""
    cv2.setNumThreads(1)
    camera, lidar = pair
    a, b = read_map(lidar.lidar), read_map(camera.camera)
    alignment = register(a, b)
    row: Report = {
        "lidar_seed": lidar.seed,
        "camera_seed": camera.seed,
        "true": lidar.seed == camera.seed,
        "accepted": alignment.accepted,
        "ambiguous": alignment.ambiguous,
        "probability": None if alignment.probability is None else round(alignment.probability, 4),
        "agreeing_wall_m": alignment.common_wall_m,
        "contradicting_wall_m": alignment.conflict_m,
        "rms_m": None,
        "rotation_deg": None,
        "drives_rms_m": None,
        "drives_rotation_deg": None,
        "T_lidar_camera": None if alignment.T_a_b is None else alignment.T_a_b.tolist(),
        "reason": alignment.reason,
        "lidar_map": str(lidar.lidar),
        "camera_map": str(camera.camera),
    }
    if row["true"]:
        row |= camera.row | _errors(a, b, alignment, camera)
    return row | {"outcome": outcome_of(row)}


def outcome_of(row: Report) -> str:
    """Return what became of a pair in one word or two, see `summary_of`."""
    if not row["true"]:
        return "wrong merge" if row["accepted"] else "refused"
    close = _is_close(row)
    if row["accepted"]:
        return "fused" if close else "fused, off"
    return "refused, right pose" if close else "refused"


def summary_of(rows: Sequence[Report]) -> Report:
    """Return the counts; fused: accepted, less than 0.15 m (rms over the common free space) and 2 deg off.

    fused_by_drives: the same where the true pose is the one that fits both drives as a whole. A map is bent by as much
    as its odometry drifts; then the frame at its start and the walls far from there have no pose in common.
    """
    true, wrong = [row for row in rows if row["true"]], [row for row in rows if not row["true"]]
    fused = [row for row in true if row["outcome"] == "fused"]
    return {
        "true_pairs": len(true),
        "fused": len(fused),
        "fused_by_drives": sum(row["accepted"] and _is_close(row, "drives_") for row in true),
        "fused_off": sum(row["outcome"] == "fused, off" for row in true),
        "refused": sum(not row["accepted"] for row in true),
        "refused_right_pose": sum(row["outcome"] == "refused, right pose" for row in true),
        "wrong_pairs": len(wrong),
        "wrong_accepted": sum(row["accepted"] for row in wrong),
        "fused_rms_m_median": _median([row["rms_m"] for row in fused]),
        "fused_rotation_deg_median": _median([row["rotation_deg"] for row in fused]),
        "camera_rms_m_median": _median([row["camera_rms_m"] for row in true]),
    }


def line_of(row: Report) -> str:
    """Return a row as a line of the table."""
    pair = f"{row['lidar_seed']:5d} {row['camera_seed']:6d}  {row['outcome']:20}"
    chance = "    -" if row["probability"] is None else f"{row['probability']:5.2f}"
    metres = "".join(
        f"{'-' if row[key] is None else format(row[key], '.1f'):>7}"
        for key in ("agreeing_wall_m", "contradicting_wall_m")
    )
    if not row["true"]:
        return f"{pair} {chance}{metres}"
    errors = "      -     -" if row["rms_m"] is None else f"{row['rms_m']:7.3f} {row['rotation_deg']:5.2f}"
    drives = "      -" if row["drives_rms_m"] is None else f"{row['drives_rms_m']:7.3f}"
    shared = f"{row['common_free']:7.0%} {row['common_wall_m']:7.1f}"
    return f"{pair} {chance}{metres} {errors} {drives} {row['camera_rms_m']:7.3f} {shared}"


def table_of(report: Report) -> str:
    """Return the report as a table for people."""
    head = (
        "SIMULATED: lidar maps and camera maps of generated buildings\n"
        "lidar camera  outcome              prob.  agree contra   rms m   deg  drives  camera   free  wall m"
    )
    close = (
        f"{report['fused']} of {report['true_pairs']} true pairs fused within {RIGHT_M} m and {RIGHT_DEG:g} deg"
        f" ({report['fused_off']} fused but farther off, {report['refused']} refused,"
        f" {report['refused_right_pose']} of these at the right pose), {report['fused_by_drives']} by the drives;"
        f" {report['wrong_accepted']} of {report['wrong_pairs']} wrong pairs accepted"
    )
    return "\n".join([head, *(line_of(row) for row in report["rows"]), close])


def _is_close(row: Report, by: str = "") -> bool:
    rms_m, rotation_deg = row[f"{by}rms_m"], row[f"{by}rotation_deg"]
    return rms_m is not None and rms_m < RIGHT_M and rotation_deg < RIGHT_DEG


def _row_of(
    visits: Sequence[Sequence[int]], lidar: MappedDrive, camera: MappedDrive, T_lidar_camera: FloatArray
) -> Report:
    free = common_free(lidar.grid, camera.grid, T_lidar_camera)
    wall_m = common_wall_m(wall_line(lidar.grid), wall_line(camera.grid), T_lidar_camera)
    return {
        "rooms": [list(rooms) for rooms in visits],
        "lidar_driven_m": round(lidar.truth.length_m, 1),
        "camera_driven_m": round(camera.truth.length_m, 1),
        "lidar_rms_m": round(lidar.rms_m, 4),
        "camera_rms_m": round(camera.rms_m, 4),
        "common_free": round(free.share, 3),
        "common_wall_m": round(wall_m, 1),
    }


def _errors(a: OccupancyGrid, b: OccupancyGrid, alignment: Alignment, maps: MapsOfOneBuilding) -> Report:
    """Return how far an alignment is from the truth, by the frames of the maps and by the drives as a whole."""
    if alignment.T_a_b is None:
        return {}
    try:
        of_frames = alignment_error(a, b, alignment.T_a_b, maps.T_lidar_camera)
        of_drives = alignment_error(a, b, alignment.T_a_b, maps.of_drives)
    except FusionError:  # no free space in common
        return {}
    return {
        "rms_m": round(of_frames.rms_m, 4),
        "rotation_deg": round(of_frames.rotation_deg, 3),
        "drives_rms_m": round(of_drives.rms_m, 4),
        "drives_rotation_deg": round(of_drives.rotation_deg, 3),
    }


def _contact_sheet(rows: Sequence[Report]) -> Image:
    """Return all pairs as small overlays, each under a bar: green for right, orange for refused, red for wrong."""
    tiles = []
    for row in rows:
        right = row["outcome"] == "fused" or (not row["true"] and not row["accepted"])
        color = _RIGHT_BGR if right else _WRONG_BGR if row["accepted"] else _REFUSED_BGR
        tile = np.full((_TILE[0] + _CAPTION_PX, _TILE[1], 3), 255, np.uint8)
        tile[:_CAPTION_PX] = color
        off = f", {row['rms_m']:.2f} m" if row["rms_m"] is not None else ""
        text = fitted(f"{row['lidar_seed']}/{row['camera_seed']} {row['outcome']}{off}", _TILE[1] - 12, 0.6)
        write_text(tile, text, (6, 19), 0.6, (255, 255, 255))
        if row["T_lidar_camera"] is not None:
            maps = read_map(Path(row["lidar_map"])), read_map(Path(row["camera_map"]))
            tile[_CAPTION_PX:] = overlay_panel(*maps, np.array(row["T_lidar_camera"]), _TILE)
        tiles.append(np.pad(tile, ((0, 6), (0, 6), (0, 0)), constant_values=255))
    while len(tiles) % _COLUMNS:
        tiles.append(np.full_like(tiles[0], 255))
    lines = [np.hstack(tiles[first : first + _COLUMNS]) for first in range(0, len(tiles), _COLUMNS)]
    return np.asarray(np.vstack(lines), dtype=np.uint8)


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 4) if values else None
