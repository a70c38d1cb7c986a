"""Two maps that grow, registered at every step by three ways, and when each way would have merged them.

Rows are JSON objects, so that a long experiment can go on where it was interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.algorithm3 import THESIS, Algorithm3Settings
from fusion.alignment import Alignment
from fusion.errors import FusionError
from fusion.evaluation import AlignmentError, common_free_points, error_at_points, free_points
from fusion.readiness import GrowingPair, ReadinessRule, Version, moved_m
from fusion.registration import register
from fusion.verification import compare
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from tools.pair_files import RIGHT_DEG, RIGHT_M
from tools.pair_overlap import common_free, common_wall_m, wall_line
from tools.results import Report

FloatArray = NDArray[np.float64]
DEFAULT = "default"
WAYS: dict[str, Algorithm3Settings | None] = {
    DEFAULT: None,
    "algorithm3": replace(THESIS, alpha=0.5, max_ratio=0.8, tolerance_px=3.0, trials=5000),
    "thesis": THESIS,
}
ENOUGH_WALL_M, ENOUGH_FREE_M2 = 8.0, 15.0  # in common, from which on two maps can be expected to be merged


def truth_row(a_file: Path, b_file: Path, T_a_b: FloatArray | None) -> Report:
    """Return what two maps know, and what they share at the true pose (3,) of b's frame in a's.

    T_a_b None: they are of different places and share nothing. Raises MapFileError.
    """
    a, b = read_map(a_file), read_map(b_file)
    return {
        "points_b": free_points(b).tolist(),
        "common_free_m2": 0.0 if T_a_b is None else common_free(a, b, T_a_b).area_m2,
        "common_wall_m": 0.0 if T_a_b is None else common_wall_m(wall_line(a), wall_line(b), T_a_b),
        "error_points_b": None if T_a_b is None else _error_points(a, b, T_a_b).tolist(),
    }


def way_row(a_file: Path, b_file: Path, way: str, seed: int) -> Report:
    """Register two maps by one of the ways. Raises MapFileError.

    Where the way does not tell how much wall agrees and contradicts, the thesis's verification counts it.
    """
    a, b = read_map(a_file), read_map(b_file)
    settings = WAYS[way]
    found = register(a, b, seed=seed) if settings is None else register(a, b, "thesis", seed, settings)
    wall_m, conflict_m = found.common_wall_m, found.conflict_m
    if wall_m is None and found.T_a_b is not None:
        agreement = compare(a, b, found.T_a_b)
        wall_m = agreement.wall_m
        conflict_m = 2.0 * wall_m * agreement.conflict / max(1.0 - agreement.conflict, 1e-9)
    return {
        "accepted": found.accepted,
        "T_a_b": None if found.T_a_b is None else found.T_a_b.tolist(),
        "probability": found.probability,
        "inliers": found.inliers,
        "acceptance": found.acceptance,
        "common_wall_m": wall_m,
        "conflict_m": conflict_m,
        "reason": found.reason,
    }


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """How a way stands after a step: its verdict on these maps alone, and what it has merged by then.

    error, merged_error: of the pose found and of the pose merged with, None without a pose or a truth. right: the pose
    merged with is within 0.5 m rms and 3 deg; None while nothing is merged. moved_m: since the step before.
    """

    accepted: bool
    error: AlignmentError | None
    moved_m: float
    merged: bool
    merged_error: AlignmentError | None
    right: bool | None
    reason: str


def outcomes(
    rows: Sequence[Report], way: str, T_a_b: FloatArray | None, rule: ReadinessRule | None
) -> list[StepOutcome]:
    """Return how a way stands after each step; rule None: it merges whatever its verdict on these maps alone is."""
    pair, result = GrowingPair(), list[StepOutcome]()
    before: Alignment | None = None
    for row in rows:
        found = _alignment_of(row[way])
        points_b = np.array(row["points_b"], dtype=np.float64).reshape(-1, 2)
        if rule is None:
            merged, reason = (found if found.accepted else None), found.reason
        else:
            pair = pair.registered(Version.of(found), points_b, rule)
            merged, reason = pair.merged, pair.reason
        merged_error = None if merged is None else _error(row, merged.T_a_b, T_a_b)
        result.append(
            StepOutcome(
                found.accepted,
                _error(row, found.T_a_b, T_a_b),
                float("inf") if before is None else moved_m(before, found, points_b),
                merged is not None,
                merged_error,
                None if merged is None else _is_right(merged_error),
                reason,
            )
        )
        before = found
    return result


def enough_from(rows: Sequence[Report]) -> int | None:
    """Return the number, from 0, of the first step at which the maps share enough, in truth; None: never."""
    for number, row in enumerate(rows):
        if row["common_wall_m"] >= ENOUGH_WALL_M and row["common_free_m2"] >= ENOUGH_FREE_M2:
            return number
    return None


def merged_from(steps: Sequence[StepOutcome]) -> int | None:
    """Return the number, from 0, of the step of the first merge; None: never."""
    return next((number for number, step in enumerate(steps) if step.merged), None)


def _alignment_of(entry: Report) -> Alignment:
    pose = None if entry["T_a_b"] is None else np.array(entry["T_a_b"], dtype=np.float64)
    return Alignment(
        pose,
        entry["accepted"],
        entry["reason"],
        inliers=entry["inliers"],
        acceptance=entry["acceptance"],
        probability=entry["probability"],
        common_wall_m=entry["common_wall_m"],
        conflict_m=entry["conflict_m"],
    )


def _error_points(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> FloatArray:
    """Return the points of map b at which errors count: of the common free space, where there is none of b's own."""
    try:
        return common_free_points(a, b, T_a_b)
    except FusionError:
        return free_points(b)


def _error(row: Report, pose: FloatArray | None, T_a_b: FloatArray | None) -> AlignmentError | None:
    if pose is None or T_a_b is None or not row["error_points_b"]:
        return None
    points_b = np.array(row["error_points_b"], dtype=np.float64)
    return error_at_points(se2.transform_points(T_a_b, points_b), points_b, pose, T_a_b)


def _is_right(error: AlignmentError | None) -> bool:
    """Tell whether a merge is right; of maps that have nothing in common none is."""
    return error is not None and error.rms_m <= RIGHT_M and error.rotation_deg <= RIGHT_DEG
