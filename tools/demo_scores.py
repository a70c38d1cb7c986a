"""The demo against the simulator's truth: each car's drive, what their maps share, and their alignment."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.evaluation import alignment_error
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.metrics import absolute_trajectory_error
from mapping.trajectory import Trajectory, read_tum
from tools.demo_cars import CarFiles, DemoCar
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.results import Report

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MappedCar:
    """What one car brought home, and where it really was."""

    car: DemoCar
    grid: OccupancyGrid
    trajectory: Trajectory
    truth: Trajectory

    @property
    def T_world_map(self) -> FloatArray:  # noqa: N802 - the name says which frames
        """The true pose (3,) of the map frame: where base_link was at the first mapped scan."""
        first = max(int(self.trajectory.stamps_ns[0]), int(self.truth.stamps_ns[0]))
        true_pose = self.truth.at(np.array([first], dtype=np.int64))[0]
        return se2.compose(true_pose, se2.inverse(self.trajectory.poses[0]))

    @property
    def T_world_drive(self) -> FloatArray:  # noqa: N802
        """The pose (3,) of the map frame that fits the whole drive best: without the map's error at its first scan."""
        return np.array(absolute_trajectory_error(self.trajectory, self.truth).T_truth_estimate)


def read_car(car: DemoCar, files: CarFiles) -> MappedCar:
    """Read what a car's live run and its emulator wrote; raises MapFileError and TrajectoryError."""
    return MappedCar(
        car, read_map(files.live / "map.npz"), read_tum(files.live / "trajectory.tum"), read_tum(files.truth)
    )


def score_car(mapped: MappedCar, files: CarFiles, emitted: int) -> Report:
    """Return how a car drove and mapped; emitted: samples that its lidar sent."""
    report = json.loads((files.live / "report.json").read_text(encoding="utf-8"))
    error = absolute_trajectory_error(mapped.trajectory, mapped.truth)
    span_s = float(np.ptp(mapped.truth.stamps_ns)) * 1e-9
    return {
        "name": mapped.car.name,
        "model": mapped.car.model,
        "resolution_m": mapped.car.resolution_m,
        "driven_m": round(mapped.truth.length_m, 2),
        "driven_s": round(span_s, 1),
        "decoded": report["decoder"]["samples"],
        "emitted": emitted,
        "scans_hz": round((report["trajectory"]["poses"] - 1) / report["trajectory"]["duration_s"], 1),
        "mapped_scans": report["scans"]["mapped"],
        "dropped_scans": report["dropped_scans"],
        "rms_m": round(error.rms_m, 4),
        "max_m": round(error.max_m, 4),
        "identical": _same(files),
    }


def score_common(a: MappedCar, b: MappedCar) -> Report:
    """Return what two maps share at their true pose: free space, as a share of the smaller one's, and wall."""
    true_T_a_b = se2.between(a.T_world_map, b.T_world_map)
    free = common_free(a.grid, b.grid, true_T_a_b)
    wall_m = common_wall_m(wall_line(a.grid), wall_line(b.grid), true_T_a_b)
    return {"overlap": round(free.share, 4), "free_m2": round(free.area_m2, 2), "wall_m": round(wall_m, 2)}


def score_alignment(a: MappedCar, b: MappedCar, pair: Report) -> Report:
    """Return how far the pose that `fuse` reports for a pair of maps is from the truth."""
    true_T_a_b = se2.between(a.T_world_map, b.T_world_map)
    scored: Report = {
        "accepted": pair["accepted"],
        "reason": pair["reason"],
        "seconds": pair["seconds"],
        "frames_apart_m": round(float(np.hypot(*true_T_a_b[:2])), 2),
        "frames_apart_deg": round(float(np.degrees(abs(true_T_a_b[2]))), 1),
        "rms_m": None,
        "rotation_deg": None,
        "rms_between_maps_m": None,
    }
    if pair["dx"] is not None:
        found = np.array([pair["dx"], pair["dy"], np.radians(pair["theta_deg"])])
        error = alignment_error(a.grid, b.grid, found, true_T_a_b)
        scored |= {"rms_m": round(error.rms_m, 4), "rotation_deg": round(error.rotation_deg, 3)}
        between_maps = alignment_error(a.grid, b.grid, found, se2.between(a.T_world_drive, b.T_world_drive))
        scored["rms_between_maps_m"] = round(between_maps.rms_m, 4)
    return scored


def _same(files: CarFiles) -> bool:
    """Whether live run and replay gave the same bytes."""
    names = ("trajectory.tum", "map.pgm", "map.yaml")
    return all((files.live / name).read_bytes() == (files.replay / name).read_bytes() for name in names)
