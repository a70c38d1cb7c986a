"""`evaluate localisation`: where the simulated car believes to be in rooms that it only looked into when it mapped.

It maps the office by a round through four rooms, and drives then through the others, at 0.5 m/s, from where it is told
to be. The odometry is SLAM's without loop closing, as on the car. Everything here is simulated.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.map_tracking import MapTracker, TrackingSettings
from mapping.reference_map import reference_map
from mapping.relocalisation import Located
from mapping.trajectory import Trajectory
from planning.costmap import UnknownSpace, costmap
from planning.vehicle import Vehicle
from tools.config import Config
from tools.mapped_drives import MappedDrive, lidar_scans, map_by_lidar
from tools.pipeline import MappingFlow
from tools.results import Report
from tools.simulated_drive import OFFICE_ROUND
from tools.simulator import drive_along
from tools.solid_world import SolidWorld, solid
from tools.world import office

FloatArray = NDArray[np.float64]
Say = Callable[[str], None]

# From the corridor through both rooms whose doors the round only passes, and back; the second is mostly unknown.
ROOMS_FROM_THE_WEST = (
    (8.0, 5.8), (8.6, 5.4), (8.9, 4.6), (8.6, 3.6), (7.7, 2.9), (7.4, 2.0), (8.0, 1.2), (9.2, 0.9), (10.1, 1.4),
    (10.9, 1.9), (11.8, 2.0), (12.3, 2.6), (12.3, 3.7), (13.0, 4.2), (13.7, 3.7), (14.3, 2.8), (14.2, 2.0), (13.3, 1.2),
    (12.6, 0.8), (12.0, 1.4), (12.2, 2.6), (12.6, 3.8), (13.4, 4.5), (13.7, 5.3), (13.0, 5.8), (11.0, 5.5),
)  # fmt: skip
ROOMS_FROM_THE_EAST = (
    (13.7, 5.8), (13.7, 4.8), (13.9, 3.8), (14.4, 2.9), (14.0, 1.4), (13.0, 1.1), (11.9, 1.8), (10.8, 1.9), (10.0, 2.4),
    (10.0, 3.4), (9.2, 3.9), (8.0, 3.8), (7.2, 3.0), (7.4, 1.8), (8.0, 1.1), (9.2, 0.9), (10.1, 1.9), (9.8, 3.2),
    (9.1, 4.1), (8.9, 4.9), (9.2, 5.6), (10.2, 5.7),
)  # fmt: skip
_SPEED_MPS = 0.5
_TOLD = np.array([0.03, -0.03, 0.02])  # so far off is what it is told
_TOLD_SPREAD = np.diag([0.1, 0.1, 0.1]) ** 2
_SETTLE = 15  # scans, while it is still being told
_BIN_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class TrackedDrive:
    """One drive on a map: error_m and error_rad (N,) of each place, chi2 (N,) of its x and y by its own covariance.

    away_m (N,): from where the map was made; fits (N,): the car fits there on the map; cpu_ms: of a scan.
    """

    error_m: FloatArray
    error_rad: FloatArray
    chi2: FloatArray
    away_m: FloatArray
    fits: NDArray[np.bool_]
    cpu_ms: float


def evaluate_localisation(seeds: Sequence[int], say: Say) -> Report:
    """Map and drive once a seed and drive, and gather the errors."""
    world, config = solid(office()), Config()
    drives = {
        "west": drive_along(ROOMS_FROM_THE_WEST, _SPEED_MPS),
        "east": drive_along(ROOMS_FROM_THE_EAST, _SPEED_MPS),
    }
    tracked: list[TrackedDrive] = []
    for seed in seeds:
        mapped = map_by_lidar(world, drive_along(OFFICE_ROUND), config, seed)
        for name, truth in drives.items():
            one = track(world, mapped, truth, config, seed + 1000)
            tracked.append(one)
            say(f"seed {seed}, from the {name}: {_rms(one.error_m):.3f} m rms, {one.error_m.max():.3f} m at most")
    return summary(tracked)


def track(world: SolidWorld, mapped: MappedDrive, truth: Trajectory, config: Config, seed: int) -> TrackedDrive:
    """Drive along the truth on a map and compare; places are judged in the frame that fits the map's drive best."""
    known = costmap(mapped.grid, replace(Vehicle(), margin_m=0.0), UnknownSpace.forbidden)
    reference, sensor = reference_map(mapped.grid), config.mount().pose[:2]
    T_map_world = se2.inverse(mapped.T_world_drive)
    flow = MappingFlow(config.with_slam(loop_closure=False, refine=False, scan_every=None), config.mount())
    tracker: MapTracker | None = None
    rows: list[tuple[float, float, float, float, bool]] = []
    busy_s, scans = 0.0, 0
    for scan in lidar_scans(world, truth, config, seed):
        for seen in flow.feed(scan):
            true = se2.compose(T_map_world, truth.at(np.array([seen.stamp_ns]))[0])
            odom = seen.match.pose
            if tracker is None:
                told = se2.compose(true, _TOLD)
                T_map_odom = se2.compose(told, se2.inverse(odom))
                found = Located(seen.stamp_ns, told, T_map_odom, _TOLD_SPREAD, 0.0, "told")
                tracker = MapTracker(reference, found, TrackingSettings(), sensor)
            begun = time.process_time()
            place = tracker.add(seen.stamp_ns, seen.points, odom)
            busy_s, scans = busy_s + time.process_time() - begun, scans + 1
            if place is None or scans <= _SETTLE:
                continue
            off = se2.between(true, place.T_map_base)
            across = place.T_map_base[:2] - true[:2]
            chi2 = float(across @ np.linalg.solve(place.covariance[:2, :2], across))
            away_m = float(np.hypot(*(mapped.trajectory.poses[:, :2] - true[:2]).T).min())
            rows.append((float(np.hypot(*off[:2])), abs(float(off[2])), chi2, away_m, known.fits(true)))
    values = np.array(rows, dtype=np.float64).reshape(-1, 5)
    error_m, error_rad, chi2, away_m, fits = values.T
    return TrackedDrive(error_m, error_rad, chi2, away_m, fits > 0.0, 1e3 * busy_s / max(scans, 1))


def summary(drives: Sequence[TrackedDrive]) -> Report:
    """Return what all drives together say, apart for where the car fits on the map and for elsewhere."""
    fits = np.concatenate([drive.fits for drive in drives])
    error_m, error_rad, chi2, away_m = (
        np.concatenate([getattr(drive, name) for drive in drives])
        for name in ("error_m", "error_rad", "chi2", "away_m")
    )
    report: Report = {"simulated": True, "drives": len(drives)}
    for part, chosen in (("fits", fits), ("elsewhere", ~fits)):
        if chosen.any():
            report[part] = {
                "places": int(chosen.sum()),
                "error_m_rms": _rms(error_m[chosen]),
                "error_m_max": float(error_m[chosen].max()),
                "error_deg_max": float(np.degrees(error_rad[chosen]).max()),
                "chi2_max": float(chi2[chosen].max()),
                "away": _by_distance(error_m[chosen], away_m[chosen]),
            }
    report["cpu_ms_median"] = float(np.median([drive.cpu_ms for drive in drives]))
    return report


def table_of(report: Report) -> list[str]:
    """Return the report as lines of text."""
    lines = [f"simulated, {report['drives']} drives, {report['cpu_ms_median']:.1f} ms of processor a scan"]
    for part, words in (("fits", "where the car fits on the map"), ("elsewhere", "elsewhere")):
        if part in report:
            row = report[part]
            lines.append(
                f"{words}: {row['places']} places, {row['error_m_rms']:.3f} m rms, {row['error_m_max']:.3f} m and"
                f" {row['error_deg_max']:.1f} deg at most, chi squared {row['chi2_max']:.1f} at most"
            )
            lines += [
                f"  {each['from_m']:.1f} m from the mapping drive: {each['places']} places,"
                f" {each['error_m_rms']:.3f} m rms, {each['error_m_max']:.3f} m at most"
                for each in row["away"]
            ]
    return lines


def _by_distance(error_m: FloatArray, away_m: FloatArray) -> list[Report]:
    bins = np.floor(away_m / _BIN_M).astype(np.int64)
    return [
        {
            "from_m": float(number * _BIN_M),
            "places": int((bins == number).sum()),
            "error_m_rms": _rms(error_m[bins == number]),
            "error_m_max": float(error_m[bins == number].max()),
        }
        for number in np.unique(bins).tolist()
    ]


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.square(values).mean()))
