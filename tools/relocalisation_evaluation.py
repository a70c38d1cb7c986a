"""`evaluate relocalisation`: a kidnapped robot on the map of another part of the same log, again and again."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.map_tracking import MapTracker, TrackingSettings
from mapping.reference_map import ReferenceMap, reference_map
from mapping.relocalisation import Located, RelocalisationSettings, Relocaliser
from mapping.sensor_models import LidarModel
from mapping.wall_map import UNKNOWN
from tools.driven_log import DrivenLog, odometry_from
from tools.errors import ToolError
from tools.results import Report

FloatArray = NDArray[np.float64]
RIGHT_M, RIGHT_DEG = 0.15, 2.0
KNOWN_SHARE = 0.7  # of a scan's points, at the start and every metre from there
_STEP_M = 1.0


class MapPart(str, Enum):
    """Which scans make the map; the robot is kidnapped in the others."""

    first_half = "first-half"
    second_half = "second-half"


@dataclass(frozen=True, slots=True)
class Kidnapping:
    """So many starts, each driven up to drive_m; those that are found are tracked for track_m more."""

    starts: int = 50
    drive_m: float = 5.0
    track_m: float = 10.0
    seed: int = 0


def map_of_part(log: DrivenLog, part: MapPart, resolution_m: float, model: LidarModel) -> OccupancyGrid:
    """Return the map of the first or second half of the scans."""
    builder = GridBuilder(resolution_m, model)
    for number in _scans_of(log, part):
        pose = log.poses[number]
        builder.add_scan(se2.transform_points(pose, log.sensor), se2.transform_points(pose, log.points[number]))
    return builder.grid()


def evaluate_relocalisation(
    log: DrivenLog,
    part: MapPart,
    grid: OccupancyGrid,
    kidnapping: Kidnapping,
    *,
    foreign: bool,
    on_progress: Callable[[str], None],
) -> Report:
    """Kidnap the robot at seeded random starts, evenly over the distance driven; return a row for each and the counts.

    grid: what `map_of_part` made; or foreign, another building's map, on which every place that is found is wrong.
    Raises ToolError where no start has enough of known surroundings.
    """
    reference = reference_map(grid)
    starts = possible_starts(log, part, None if foreign else reference, kidnapping.drive_m)
    if len(starts) == 0:
        raise ToolError(f"no {kidnapping.drive_m:g} m of driving outside of the {part.value} lie in what its map knows")
    weights = np.diff(log.travelled_m, append=log.travelled_m[-1])[starts] + 1e-9
    chosen = np.random.default_rng(kidnapping.seed).choice(starts, kidnapping.starts, p=weights / weights.sum())
    Relocaliser(reference, RelocalisationSettings()).add(0, log.points[0], se2.IDENTITY)  # load what is compiled
    rows = []
    for start in chosen.tolist():
        row = _kidnap(log, reference, start, part, kidnapping, foreign=foreign)
        rows.append(row)
        on_progress(f"{row['stamp_s']:.2f} s: {row['verdict']} after {row['driven_m']:.1f} m ({row['reason']})")
    verdicts = Counter(row["verdict"] for row in rows)
    found = [row for row in rows if row["verdict"] == "found"]
    seconds = [row["slowest_search_cpu_s"] for row in rows]
    return {
        "map_part": part.value,
        "foreign_map": foreign,
        "seed": kidnapping.seed,
        "drive_m": kidnapping.drive_m,
        "map_m": [round(float(cells * grid.resolution_m), 1) for cells in reversed(grid.log_odds.shape)],
        "possible_starts": len(starts),
        "starts": len(rows),
        "found": verdicts["found"],
        "not_found": verdicts["not found"],
        "wrong": verdicts["WRONG"],
        "driven_m_median": _median([row["driven_m"] for row in found]),
        "error_m_median": _median([row["error_m"] for row in found]),
        "error_m_max": max((row["error_m"] for row in found), default=None),
        "error_deg_max": max((row["error_deg"] for row in found), default=None),
        "tracked_scans": sum(row["tracked_scans"] for row in found),
        "tracked_by_odometry": sum(row["tracked_by_odometry"] for row in found),
        "tracking_error_m_median": _median([row["tracking_error_m_median"] for row in found if row["tracked_scans"]]),
        "tracking_error_m_max": max(
            (row["tracking_error_m_max"] for row in found if row["tracked_scans"]), default=None
        ),
        "tracks_lost": sum(row["track_lost"] for row in found),
        "slowest_search_cpu_s_median": _median(seconds),
        "slowest_search_cpu_s_max": max(seconds),
        "rows": rows,
    }


def possible_starts(log: DrivenLog, part: MapPart, reference: ReferenceMap | None, drive_m: float) -> NDArray[np.int64]:
    """Return the scans outside of the map's part from which drive_m can be driven where the map knows the place.

    It does where KNOWN_SHARE of the scan's points, put where the log's pose says, fall on known cells; this is asked at
    the start and at every metre. It says nothing about whether the walls still stand there.
    """
    scans = np.setdiff1d(np.arange(len(log.stamps_ns)), _scans_of(log, part))
    travelled, last = log.travelled_m, int(scans[-1])
    known: dict[int, bool] = {}
    starts = []
    for start in scans.tolist():
        if travelled[start] + drive_m > travelled[last]:
            continue
        steps = travelled[start] + np.append(np.arange(0.0, drive_m, _STEP_M), drive_m)
        for number in np.searchsorted(travelled, steps).tolist():
            if number not in known:
                known[number] = reference is None or _known_share(log, reference, number) >= KNOWN_SHARE
            if not known[number]:
                break
        else:
            starts.append(start)
    return np.array(starts, dtype=np.int64)


def _scans_of(log: DrivenLog, part: MapPart) -> NDArray[np.int64]:
    """Return the numbers of the scans that make the map."""
    middle = len(log.stamps_ns) // 2
    return np.arange(middle) if part is MapPart.first_half else np.arange(middle, len(log.stamps_ns))


def _known_share(log: DrivenLog, reference: ReferenceMap, number: int) -> float:
    """Return the share of a scan's points that fall on known cells."""
    pose = se2.compose(se2.inverse(reference.walls.T_map_grid), log.poses[number])
    col, row = (
        np.floor(se2.transform_points(pose, log.points[number]) / reference.walls.resolution_m).astype(np.int64).T
    )
    rows, cols = reference.walls.states.shape
    inside = (col >= 0) & (row >= 0) & (col < cols) & (row < rows)
    known = reference.walls.states[row[inside], col[inside]] != UNKNOWN
    return float(np.count_nonzero(known)) / max(len(col), 1)


def _kidnap(
    log: DrivenLog, reference: ReferenceMap, start: int, part: MapPart, kidnapping: Kidnapping, *, foreign: bool
) -> Report:
    """Switch the robot on at a start and let it drive."""
    relocaliser = Relocaliser(reference, RelocalisationSettings(), log.sensor)
    tracker: MapTracker | None = None
    place: Located | None = None
    driven_m, slowest_s, until_m = 0.0, 0.0, kidnapping.drive_m
    errors: list[float] = []
    by_odometry = 0
    row: Report = {"stamp_s": float(log.stamps_ns[start] * 1e-9), "error_m": None, "error_deg": None}
    last = len(log.stamps_ns) - 1 if part is MapPart.first_half else len(log.stamps_ns) // 2 - 1
    for number, T_odom_base in odometry_from(log, start):
        driven_m = float(log.travelled_m[number] - log.travelled_m[start])
        if number > last or driven_m > until_m:
            break
        stamp_ns, points = int(log.stamps_ns[number]), log.points[number]
        if tracker is not None:
            tracked = tracker.add(stamp_ns, points, T_odom_base)
            if tracked is None:
                break
            by_odometry += tracked.by_odometry
            if not tracked.by_odometry:
                errors.append(_error(log.poses[number], tracked)[0])
            continue
        before, started = relocaliser.searches, time.process_time()
        place = relocaliser.add(stamp_ns, points, T_odom_base)
        if relocaliser.searches > before:
            slowest_s = max(slowest_s, time.process_time() - started)
        if place is not None:
            row |= {"driven_m": round(driven_m, 2), "verdict": "WRONG"}
            if foreign:
                break
            error_m, error_deg = _error(log.poses[number], place)
            row |= {"error_m": round(error_m, 4), "error_deg": round(error_deg, 3)}
            if error_m > RIGHT_M or error_deg > RIGHT_DEG:
                break
            row["verdict"] = "found"
            tracker = MapTracker(reference, place, TrackingSettings(), log.sensor)
            until_m = driven_m + kidnapping.track_m
    if place is None:
        row |= {"driven_m": round(min(driven_m, kidnapping.drive_m), 2), "verdict": "not found"}
    return row | {
        "searches": relocaliser.searches,
        "slowest_search_cpu_s": round(slowest_s, 4),
        "reason": relocaliser.reason,
        "tracked_scans": len(errors),
        "tracked_by_odometry": by_odometry,
        "tracking_error_m_median": _median(errors),
        "tracking_error_m_max": round(max(errors), 4) if errors else None,
        "track_lost": tracker is not None and tracker.lost,
    }


def _error(truth: FloatArray, place: Located) -> tuple[float, float]:
    """Return metres and degrees between the log's pose and the one found."""
    apart = se2.between(truth, place.T_map_base)
    return math.hypot(apart[0], apart[1]), abs(math.degrees(apart[2]))


def _median(values: list[float]) -> float | None:
    return round(float(np.median(values)), 4) if values else None
